// Memory of this process as Linux counts it (/proc/self/status, /proc/self/clear_refs).
#pragma once

long ResidentBytes();
long PeakResidentBytes();

// Restarts the peak at the present resident size, so that it no longer counts what reading the file
// took.
void ResetPeak();

// The machine that this process runs on, and what of it is left to the process.
#pragma once

#include <string>

namespace sfmcpp {

// Physical memory in bytes, or what the control groups of this process (a container, a batch job)
// may have of it. Limits of groups are read once: a small solve takes hardly longer than that.
double memory_limit_bytes();

// Cores that this process may keep busy, one at least: those that it is bound to, or as many as its
// control groups have time for.
int usable_cores();

// The same, read anew, where the files of the system are below `root`.
double memory_limit_bytes(const std::string& root);
int usable_cores(const std::string& root);

// A whole number that identifies this machine, made from its name.
double machine_number();

}  // namespace sfmcpp

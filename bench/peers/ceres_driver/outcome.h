// What the driver reports, in the form the harness reads (harness/protocol.py, class Outcome).
#pragma once

#include <string>

#include <ceres/ceres.h>

struct Memory {
  long start_bytes;
  long inputs_bytes;
  long peak_bytes;
};

void WriteOutcome(const ceres::Solver::Summary& summary,
                  const Memory& memory,
                  const std::string& path);

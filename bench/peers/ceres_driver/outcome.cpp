#include "outcome.h"

#include <fstream>
#include <iomanip>
#include <stdexcept>

namespace {

// A rejected step keeps the cost of the state before it; Ceres records the cost of the step it
// refused.
void WriteTrace(const ceres::Solver::Summary& summary, std::ostream& out) {
  double accepted_cost = summary.initial_cost;
  const char* separator = "";
  for (const ceres::IterationSummary& iteration : summary.iterations) {
    if (iteration.step_is_successful) accepted_cost = iteration.cost;
    out << separator << "[" << iteration.cumulative_time_in_seconds << ", " << accepted_cost << "]";
    separator = ", ";
  }
}

}  // namespace

void WriteOutcome(const ceres::Solver::Summary& summary,
                  const Memory& memory,
                  const std::string& path) {
  std::ofstream out(path);
  out << std::setprecision(17) << "{\"trace\": [";
  WriteTrace(summary, out);
  out << "],\n \"seconds_total\": " << summary.total_time_in_seconds
      << ",\n \"own_cost\": " << summary.final_cost
      << ",\n \"message\": " << std::quoted(summary.message)
      << ",\n \"start_bytes\": " << memory.start_bytes
      << ", \"inputs_bytes\": " << memory.inputs_bytes << ", \"peak_bytes\": " << memory.peak_bytes
      << "}\n";
  if (!out.flush()) throw std::runtime_error(path + ": cannot be written");
}

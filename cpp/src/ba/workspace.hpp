// Everything that a solve owns, in the order in which it must be constructed.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "sfmcpp/ba/bundle_model.hpp"
#include "sfmcpp/ba/solve_options.hpp"
#include "sfmcpp/ba/world_frame.hpp"

namespace sfmcpp::ba {

// The columns of observations and of rows on points.
linear::ParameterMap make_parameter_map(const Problem& problem,
                                        const linear::ObservationGraph& graph,
                                        const PointRows& rows,
                                        const std::vector<int>& free_intrinsics,
                                        const std::vector<PoseParameter>& gauge = {});

struct Workspace {
  // Throws InvalidArgument for a problem, a start or options that break a rule: on every rank if it
  // is so on one.
  Workspace(const Problem& problem,
            const SolveOptions& options,
            const optim::State& start,
            Exchange& exchange = this_process());

  Exchange& exchange;
  BorrowedPool threads;
  ThreadPool& pool;
  linear::ObservationGraph graph;
  PointRows rows;
  std::vector<int> intrinsics;
  linear::ParameterMap map;
  linear::Precision precision;
  linear::LinearSolverChoice choice;  // before the memory that it may refuse is asked for
  BundleModel model;
  std::unique_ptr<linear::LinearSolver> solver;  // refuses to solve for methods without a system
};

// While it lives, the state of a projective problem is in the frame of ba/world_frame.hpp. What is
// fixed comes back with the same bits.
class ScopedFrame {
 public:
  ScopedFrame(const Problem& problem, optim::State& state, Exchange& exchange = this_process());
  ~ScopedFrame();
  ScopedFrame(const ScopedFrame&) = delete;
  ScopedFrame& operator=(const ScopedFrame&) = delete;

 private:
  const Problem& problem_;
  optim::State& state_;
  optim::State before_;
  std::optional<WorldFrame> frame_;
};

}  // namespace sfmcpp::ba

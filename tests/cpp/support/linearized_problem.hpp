// A problem with all it takes to linearise it at its start: the input of every test of linear
// algebra.
#pragma once

#include <vector>

#include "sfmcpp/ba/bundle_model.hpp"
#include "sfmcpp/ba/mask.hpp"
#include "sfmcpp/linear/linear_solver.hpp"
#include "support/small_scenes.hpp"

namespace sfmcpp::support {

struct LinearizedProblem {
  explicit LinearizedProblem(const OwnedProblem& scene, bool fix_gauge = false, int threads = 1)
      : owned(scene),
        problem(owned.view()),
        graph(ba::graph_of(problem)),
        rows(problem, graph),
        free_intrinsics(ba::free_intrinsics(problem, graph)),
        map(ba::make_parameter_map(problem,
                                   graph,
                                   free_intrinsics,
                                   fix_gauge ? choose_gauge(problem, graph, ba::state_of(problem))
                                             : std::vector<ba::PoseParameter>{})),
        pool(threads),
        model(problem, graph, rows, map, free_intrinsics, pool),
        state(ba::state_of(problem)) {
    model.linearize(state);
  }

  const linear::NormalEquations& normal() const { return model.normal_equations(); }

  linear::LinearSolveResult solve(const linear::LinearSolverOptions& options,
                                  const linear::Damping& damping,
                                  linear::Step& step) const {
    return linear::make_linear_solver(normal(), options)->solve(damping, step, [] {
      return false;
    });
  }

  OwnedProblem owned;
  ba::Problem problem;
  linear::ObservationGraph graph;
  ba::PointRows rows;
  std::vector<int> free_intrinsics;
  linear::ParameterMap map;
  ThreadPool pool;
  ba::BundleModel model;
  optim::State state;
};

}  // namespace sfmcpp::support

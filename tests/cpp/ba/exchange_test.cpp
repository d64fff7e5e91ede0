// A problem cut by its points among ranks has the answer of the whole: threads play the ranks, each
// with all cameras and a part of the points (core/exchange.hpp).
#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>

#include "sfmcpp/ba/solve.hpp"
#include "sfmcpp/core/error.hpp"
#include "support/cut_scene.hpp"
#include "support/enumerators.hpp"
#include "support/random_constraints.hpp"
#include "support/threaded_exchange.hpp"

namespace sfmcpp::ba::exchange_test {
namespace {

using linear::LinearSolverKind;
using optim::LineSearchKind;
using optim::Method;
using optim::State;
using support::chain_scene;
using support::identifier;
using support::observed_where;
using support::OwnedProblem;
using support::part_of;
using Kind = residuals::ConstraintKind;

struct Answer {
  SolveSummary summary;
  State state;
};

Answer solve_whole(const OwnedProblem& scene, const SolveOptions& options) {
  Answer answer{{}, state_of(scene.view())};
  answer.summary = solve(scene.view(), options, {}, answer.state);
  return answer;
}

using EventsOf = std::function<optim::Events(int rank)>;

// Of each rank.
std::vector<Answer> solve_in_parts(
    const OwnedProblem& scene,
    const SolveOptions& options,
    int num_ranks,
    const EventsOf& events_of = [](int) { return optim::Events{}; }) {
  std::vector<Answer> answers(num_ranks);
  support::play_ranks(num_ranks, [&](Exchange& exchange) {
    const int rank = exchange.rank();
    const OwnedProblem part = part_of(scene, rank, num_ranks);
    Answer& answer = answers[rank];
    answer.state = state_of(part.view());
    answer.summary = solve(part.view(), options, events_of(rank), answer.state, exchange);
  });
  return answers;
}

void expect_same_bits(const std::vector<Answer>& a, const std::vector<Answer>& b) {
  for (std::size_t rank = 0; rank < a.size(); ++rank) {
    EXPECT_EQ(a[rank].state.cameras, b[rank].state.cameras);
    EXPECT_EQ(a[rank].state.intrinsics, b[rank].state.intrinsics);
    EXPECT_EQ(a[rank].state.points, b[rank].state.points);
    EXPECT_EQ(a[rank].summary.minimizer.final_cost, b[rank].summary.minimizer.final_cost);
  }
}

// What is replicated has the same bits on every rank.
void expect_agreement(const std::vector<Answer>& answers) {
  const Answer& first = answers.front();
  for (const Answer& other : answers) {
    EXPECT_EQ(other.state.cameras, first.state.cameras);
    EXPECT_EQ(other.state.intrinsics, first.state.intrinsics);
    EXPECT_EQ(other.summary.minimizer.termination, first.summary.minimizer.termination);
    EXPECT_EQ(other.summary.final_rms_px, first.summary.final_rms_px);
    EXPECT_EQ(other.summary.loss_scale_px, first.summary.loss_scale_px);
    EXPECT_EQ(other.summary.linear_solver.kind, first.summary.linear_solver.kind);
    const auto &theirs = other.summary.minimizer.iterations,
               &ours = first.summary.minimizer.iterations;
    ASSERT_EQ(theirs.size(), ours.size());
    for (std::size_t k = 0; k < ours.size(); ++k) {
      EXPECT_EQ(theirs[k].cost, ours[k].cost);
      EXPECT_EQ(theirs[k].gradient_norm, ours[k].gradient_norm);
      EXPECT_EQ(theirs[k].step_norm, ours[k].step_norm);
      EXPECT_EQ(theirs[k].damping, ours[k].damping);
      EXPECT_EQ(theirs[k].lengths, ours[k].lengths);
    }
  }
}

// The points of all ranks in their order of the whole.
std::vector<double> joined_points(const std::vector<Answer>& answers, int width) {
  std::vector<double> points;
  std::size_t count = 0;
  for (const Answer& answer : answers) count += answer.state.points.size() / width;
  for (std::size_t p = 0; p < count; ++p) {
    const std::vector<double>& part = answers[p % answers.size()].state.points;
    const auto first = part.begin() + static_cast<long>(width * (p / answers.size()));
    points.insert(points.end(), first, first + width);
  }
  return points;
}

double largest_difference(const std::vector<double>& a, const std::vector<double>& b) {
  EXPECT_EQ(a.size(), b.size());
  double largest = 0.0;
  for (std::size_t k = 0; k < a.size(); ++k) largest = std::max(largest, std::abs(a[k] - b[k]));
  return largest;
}

// Rounding alone sets a sum over ranks apart from one over all observations. Costs of the steps to
// 1e-9; unknowns, which feel rounding times the condition of the problem, to 1e-6.
constexpr double kCostTolerance = 1e-9;
constexpr double kStateTolerance = 1e-6;

void expect_the_answer_of_the_whole(const std::vector<Answer>& parts,
                                    const Answer& whole,
                                    int point_width) {
  const SolveSummary& found = parts.front().summary;
  EXPECT_EQ(found.minimizer.termination, whole.summary.minimizer.termination);
  EXPECT_EQ(found.linear_solver.kind, whole.summary.linear_solver.kind);
  EXPECT_EQ(found.behind_camera_initial, whole.summary.behind_camera_initial);
  EXPECT_NEAR(found.initial_rms_px / whole.summary.initial_rms_px, 1.0, 1e-12);
  EXPECT_NEAR(found.loss_scale_px / whole.summary.loss_scale_px, 1.0, 1e-12);
  EXPECT_NEAR(found.final_rms_px / whole.summary.final_rms_px, 1.0, kCostTolerance);
  const auto &steps = found.minimizer.iterations, &expected = whole.summary.minimizer.iterations;
  ASSERT_EQ(steps.size(), expected.size());
  for (std::size_t k = 0; k < steps.size(); ++k) {
    EXPECT_NEAR(steps[k].cost / expected[k].cost, 1.0, kCostTolerance) << "step " << k;
    EXPECT_EQ(steps[k].accepted, expected[k].accepted);
  }
  for (std::size_t k = 0; k < found.constraint_costs.size(); ++k) {
    EXPECT_NEAR(found.constraint_costs[k].final_cost / whole.summary.constraint_costs[k].final_cost,
                1.0,
                1e-6);
  }
  EXPECT_LT(largest_difference(parts.front().state.cameras, whole.state.cameras), kStateTolerance);
  EXPECT_LT(largest_difference(joined_points(parts, point_width), whole.state.points),
            kStateTolerance);
}

void expect_cutting_changes_nothing(const OwnedProblem& scene,
                                    const SolveOptions& options,
                                    int num_ranks) {
  const Answer whole = solve_whole(scene, options);
  ASSERT_LT(whole.summary.minimizer.final_cost, whole.summary.minimizer.initial_cost);
  const std::vector<Answer> parts = solve_in_parts(scene, options, num_ranks);
  expect_agreement(parts);
  expect_the_answer_of_the_whole(parts, whole, scene.view().point_storage());
  expect_same_bits(parts, solve_in_parts(scene, options, num_ranks));
}

OwnedProblem scene_of(CameraModelId model, int groups = 0) {
  support::SceneOptions options = support::perturbed(model);
  options.num_points = 41;  // the ranks have different numbers of them
  options.num_groups = groups;
  options.varied_sigma = true;
  return make_circle_scene(options);
}

SolveOptions options_of(Method method, LinearSolverKind solver = LinearSolverKind::kAuto) {
  SolveOptions options;
  options.minimizer.method = method;
  options.minimizer.termination.max_iterations = 8;
  options.minimizer.termination.function_tolerance = 1e-6;
  options.linear_solver.kind = solver;
  const bool direct = solver == LinearSolverKind::kDense || solver == LinearSolverKind::kSparse;
  if (!direct && facts_of(method).solves_linear_system)  // steps to rounding, as of the others
    options.linear_solver = {.kind = solver, .pcg_tolerance = 1e-12, .pcg_max_iterations = 2000};
  return options;
}

struct Case {
  std::string name;
  OwnedProblem scene;
  SolveOptions options;
};
void PrintTo(const Case& c, std::ostream* out) { *out << c.name; }

std::vector<Case> methods_and_solvers() {
  std::vector<Case> cases;
  for (const auto& [method, method_name] : EnumNames<Method>::kTable) {
    for (const auto& [solver, solver_name] : EnumNames<LinearSolverKind>::kTable) {
      SolveOptions options = options_of(method, solver);
      try {
        options.validate();
      } catch (const InvalidArgument&) {
        continue;  // a solver that this method cannot heed
      }
      // Its Gauss–Newton steps have too little damping for a free gauge to be well-conditioned.
      if (method == Method::kDogLeg) options.gauge = Gauge::kFixed;
      cases.push_back({identifier(std::string(method_name) + "_" + std::string(solver_name)),
                       scene_of(CameraModelId::kPerspective),
                       options});
    }
  }
  return cases;
}

Case with_solver(const char* name, OwnedProblem scene, LinearSolverKind solver) {
  return {std::string(name) + "_" + std::string(enum_name(solver)),
          std::move(scene),
          options_of(Method::kLevenbergMarquardtNielsen, solver)};
}

OwnedProblem constrained_scene() {
  OwnedProblem scene = scene_of(CameraModelId::kPerspective);
  scene.constraints.add(random_group(scene, Kind::kPosition, {{0, 1}, {1, 3}, {2, 5}}));
  scene.constraints.add(random_group(scene, Kind::kDisplacementPose, {{1, 4}, {4, 5}}));
  return scene;
}

OwnedProblem scene_with_covariances() {
  support::SceneOptions options = support::perturbed(CameraModelId::kPerspective);
  options.num_points = 41;
  options.covariances = true;
  return make_circle_scene(options);
}

std::vector<Case> solvers_and_structures() {
  std::vector<Case> cases;
  for (LinearSolverKind solver :
       {LinearSolverKind::kDense, LinearSolverKind::kSparse, LinearSolverKind::kIterative}) {
    cases.push_back(with_solver("Shared", scene_of(CameraModelId::kBal, 2), solver));
    cases.push_back(with_solver("Constrained", constrained_scene(), solver));
    cases.push_back(with_solver("Projective", scene_of(CameraModelId::kProjective), solver));
    cases.push_back(with_solver("Covariances", scene_with_covariances(), solver));
    cases.push_back(with_solver("Chain", chain_scene(), solver));
    cases.push_back(with_solver("FixedPoints", scene_of(CameraModelId::kCalibrated), solver));
    for (int p : {0, 3, 5}) cases.back().scene.fixed_points[p] = 1;
    cases.push_back(with_solver("Gauge", scene_of(CameraModelId::kCalibrated), solver));
    cases.back().options.gauge = Gauge::kFixed;
    cases.push_back(with_solver("GaugeLeftByFixedPoints", scene_of(CameraModelId::kBal), solver));
    for (int p : {1, 2}) cases.back().scene.fixed_points[p] = 1;
    cases.back().options.gauge = Gauge::kFixed;
  }
  return cases;
}

std::vector<Case> losses_and_searches() {
  std::vector<Case> cases;
  for (LossKind loss : {LossKind::kHuber, LossKind::kCauchy, LossKind::kTukey}) {
    Case c{"Loss_" + std::string(enum_name(loss)),
           scene_of(CameraModelId::kPerspective),
           options_of(Method::kLevenbergMarquardt)};
    c.options.loss = loss;
    c.options.loss_scale_px.reset();  // from the residuals at the start
    cases.push_back(c);
  }
  for (const auto& [search, name] : EnumNames<LineSearchKind>::kTable) {
    for (CameraModelId model : {CameraModelId::kPerspective, CameraModelId::kProjective}) {
      Case c{identifier("Search_" + std::string(name) + "_" + std::string(enum_name(model))),
             scene_of(model),
             options_of(Method::kLevenbergMarquardtNielsen)};
      c.options.minimizer.line_search.kind = search;
      if (search != LineSearchKind::kNone) c.options.minimizer.line_search.iterations = 4;
      cases.push_back(c);
    }
  }
  return cases;
}

class CutProblem : public testing::TestWithParam<Case> {};

TEST_P(CutProblem, HasTheAnswerOfTheWhole) {
  for (int num_ranks : {2, 3})
    expect_cutting_changes_nothing(GetParam().scene, GetParam().options, num_ranks);
}

const auto kNameOfCase = [](const auto& test) { return test.param.name; };
INSTANTIATE_TEST_SUITE_P(Methods,
                         CutProblem,
                         testing::ValuesIn(methods_and_solvers()),
                         kNameOfCase);
INSTANTIATE_TEST_SUITE_P(Structures,
                         CutProblem,
                         testing::ValuesIn(solvers_and_structures()),
                         kNameOfCase);
INSTANTIATE_TEST_SUITE_P(Losses, CutProblem, testing::ValuesIn(losses_and_searches()), kNameOfCase);

TEST(Exchange, OutliersAreToldAlikeHoweverPointsAreCut) {
  OwnedProblem scene = scene_of(CameraModelId::kPerspective);
  support::spoil(scene, 0.2);
  SolveOptions options = options_of(Method::kLevenbergMarquardtNielsen);
  options.loss = LossKind::kAuto;
  for (int ranks : {2, 3}) expect_cutting_changes_nothing(scene, options, ranks);
}

TEST(Exchange, ACameraThatOnlyAnotherRankSeesIsObserved) {
  const OwnedProblem cut =
      observed_where(scene_of(CameraModelId::kPerspective),
                     [](int camera, int point) { return camera != 2 || point % 2 == 1; });
  for (LinearSolverKind solver :
       {LinearSolverKind::kDense, LinearSolverKind::kSparse, LinearSolverKind::kIterative})
    expect_cutting_changes_nothing(cut, options_of(Method::kLevenbergMarquardtNielsen, solver), 2);
}

// S·x is a sum over ranks, each with the blocks of its points; its steps are among those above.
TEST(Exchange, EachRankKeepsItsBlocks) {
  const Case chain = with_solver("Chain", chain_scene(), LinearSolverKind::kIterative);
  for (const Answer& answer : solve_in_parts(chain.scene, chain.options, 3))
    EXPECT_TRUE(answer.summary.linear_solver.with_blocks);
}

TEST(Exchange, ARankWithoutPointsTakesPart) {
  support::SceneOptions options = support::perturbed(CameraModelId::kCalibrated);
  options.num_points = 20;
  const OwnedProblem scene = make_circle_scene(options);
  const SolveOptions chosen = options_of(Method::kLevenbergMarquardtNielsen);
  const Answer whole = solve_whole(scene, chosen);
  std::vector<Answer> answers(2);
  support::play_ranks(2, [&](Exchange& exchange) {
    OwnedProblem part = scene;
    if (!exchange.is_root()) part = part_of(scene, 20, 21);
    Answer& answer = answers[exchange.rank()];
    answer.state = state_of(part.view());
    answer.summary = solve(part.view(), chosen, {}, answer.state, exchange);
  });
  EXPECT_TRUE(answers[1].state.points.empty());
  expect_agreement(answers);
  EXPECT_NEAR(answers[1].summary.minimizer.final_cost / whole.summary.minimizer.final_cost,
              1.0,
              kCostTolerance);
}

class StopOfOneRank : public testing::TestWithParam<Method> {};

TEST_P(StopOfOneRank, StopsAllAtTheSameStep) {
  SolveOptions options = options_of(GetParam());
  options.minimizer.termination.function_tolerance = 0.0;
  for (int stopping : {0, 1}) {
    const auto events_of = [&](int rank) {
      optim::Events events;
      events.on_iteration = [=](const optim::Iteration& iteration) {
        const bool stop = rank == stopping && iteration.number == 3;
        return stop ? optim::Signal::kStop : optim::Signal::kContinue;
      };
      return events;
    };
    const auto answers =
        solve_in_parts(scene_of(CameraModelId::kPerspective), options, 2, events_of);
    expect_agreement(answers);
    for (const Answer& answer : answers) {
      EXPECT_EQ(answer.summary.minimizer.termination, optim::Termination::kStoppedByCallback);
      EXPECT_EQ(answer.summary.minimizer.iterations.size(), 4u);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(
    Methods,
    StopOfOneRank,
    testing::Values(Method::kLevenbergMarquardt, Method::kConjugateGradient, Method::kAlternation),
    [](const auto& test) { return identifier(std::string(enum_name(test.param))); });

TEST(Exchange, AnInterruptThatOneRankMeetsWithinAStepEndsAll) {
  const SolveOptions options =
      options_of(Method::kLevenbergMarquardtNielsen, LinearSolverKind::kIterative);
  for (int interrupted : {0, 1}) {
    const auto events_of = [&](int rank) {
      optim::Events events;
      events.poll = [=] {
        return rank == interrupted ? optim::Signal::kInterrupt : optim::Signal::kContinue;
      };
      return events;
    };
    const auto answers =
        solve_in_parts(scene_of(CameraModelId::kPerspective), options, 2, events_of);
    expect_agreement(answers);
    EXPECT_EQ(answers[0].summary.minimizer.termination, optim::Termination::kInterrupted);
  }
}

TEST(Exchange, WhatOneRankRefusesIsRefusedByAll) {
  OwnedProblem scene = scene_of(CameraModelId::kCalibrated);
  scene.points[3] = NAN;  // of rank 1
  std::vector<std::string> messages(2);
  support::play_ranks(2, [&](Exchange& exchange) {
    const OwnedProblem part = part_of(scene, exchange.rank(), 2);
    State state = state_of(part.view());
    try {
      solve(part.view(), {}, {}, state, exchange);
    } catch (const InvalidArgument& error) {
      messages[exchange.rank()] = error.what();
    }
  });
  EXPECT_EQ(messages[1], "points[0] = nan: must be finite");
  EXPECT_EQ(messages[0], "rank 1: points[0] = nan: must be finite");
}

TEST(Exchange, PartsThatShareAPointOnSomeRankAreOne) {
  for (const Answer& answer : solve_in_parts(chain_scene(), options_of(Method::kDogLeg), 3))
    EXPECT_TRUE(answer.summary.warnings.empty());
}

}  // namespace
}  // namespace sfmcpp::ba::exchange_test

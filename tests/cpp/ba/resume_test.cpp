// A solve that goes on from where another stood ends with the bits of one that never stopped.
#include <ostream>

#include <gtest/gtest.h>

#include "sfmcpp/ba/solve.hpp"
#include "sfmcpp/core/error.hpp"
#include "support/all_models.hpp"
#include "support/cut_scene.hpp"
#include "support/enumerators.hpp"
#include "support/threaded_exchange.hpp"

namespace sfmcpp::ba::resume_test {
namespace {

using linear::LinearSolverKind;
using optim::Iteration;
using optim::LineSearchKind;
using optim::Method;
using optim::Resumption;
using optim::State;

struct Outcome {
  State state;
  SolveSummary summary;
  std::vector<Resumption> stood;  // after each iteration
};

struct Case {
  std::string name;
  SolveOptions options;
  CameraModelId model = CameraModelId::kBal;
  double share_of_outliers = 0.0;
};
void PrintTo(const Case& c, std::ostream* out) { *out << c.name; }

support::OwnedProblem scene(CameraModelId model, double share_of_outliers = 0.0) {
  support::SceneOptions options = support::perturbed(model);
  options.num_groups = 2;
  options.num_points = 30;
  options.varied_sigma = true;
  support::OwnedProblem problem = make_circle_scene(options);
  // So far off that steps are rejected, and points held.
  for (std::size_t k = 0; k < problem.points.size() && is_metric(model); k += 7)
    problem.points[k] *= 1.6;
  support::spoil(problem, share_of_outliers);
  return problem;
}

Outcome run(const Case& c, const Resumption* resumed = nullptr, optim::Events events = {}) {
  const support::OwnedProblem problem = scene(c.model, c.share_of_outliers);
  Outcome outcome{.state = state_of(problem.view()), .summary = {}, .stood = {}};
  events.on_resumable = [&](const std::function<Resumption()>& where, bool) {
    outcome.stood.push_back(where());
  };
  outcome.summary =
      solve(problem.view(), c.options, events, outcome.state, this_process(), resumed);
  return outcome;
}

void expect_same(const Iteration& a, const Iteration& b) {
  Iteration timeless = a;
  timeless.seconds = b.seconds;
  Iteration other = b;
  EXPECT_EQ(optim::save(timeless), optim::save(other));
}

void expect_same(const Outcome& a, const Outcome& b) {
  EXPECT_EQ(a.state.cameras, b.state.cameras);
  EXPECT_EQ(a.state.intrinsics, b.state.intrinsics);
  EXPECT_EQ(a.state.points, b.state.points);
  const SolveSummary &s = a.summary, &t = b.summary;
  EXPECT_EQ(s.minimizer.initial_cost, t.minimizer.initial_cost);
  EXPECT_EQ(s.minimizer.final_cost, t.minimizer.final_cost);
  EXPECT_EQ(s.minimizer.message, t.minimizer.message);
  EXPECT_EQ(s.initial_rms_px, t.initial_rms_px);
  EXPECT_EQ(s.final_rms_px, t.final_rms_px);
  EXPECT_EQ(s.behind_camera_initial, t.behind_camera_initial);
  EXPECT_EQ(s.loss_scale_px, t.loss_scale_px);
  ASSERT_EQ(s.minimizer.iterations.size(), t.minimizer.iterations.size());
  for (std::size_t k = 0; k < s.minimizer.iterations.size(); ++k)
    expect_same(s.minimizer.iterations[k], t.minimizer.iterations[k]);
}

SolveOptions options_of(Method method) {
  SolveOptions options;
  options.minimizer.method = method;
  options.minimizer.termination.max_iterations = 12;
  options.minimizer.termination.function_tolerance = 1e-12;
  return options;
}

bool takes_steps(Method method, CameraModelId model) {
  return !facts_of(method).needs_fixed_gauge() || is_metric(model);
}

template <class E, class Set>
void add_each(const std::string& what, const Set& set, std::vector<Case>& cases) {
  for (const auto& row : EnumTraits<E>::kTable) {
    Case c{what + "_" + std::string(row.name), options_of(Method::kLevenbergMarquardtNielsen)};
    set(c.options, row.value);
    cases.push_back(c);
  }
}

std::vector<Case> cases() {
  std::vector<Case> cases;
  for (const auto& method : EnumTraits<Method>::kTable) {
    for (CameraModelId model : support::all_models()) {
      if (!takes_steps(method.value, model)) continue;
      const std::string name = std::string(method.name) + "_" + std::string(enum_name(model));
      cases.push_back({name, options_of(method.value), model});
      if (method.value == Method::kGaussNewton) continue;
      cases.push_back({name + "_cauchy", options_of(method.value), model});
      cases.back().options.loss = LossKind::kCauchy;
    }
    for (const auto& search : EnumTraits<LineSearchKind>::kTable) {
      const std::string name = std::string(method.name) + "_" + std::string(search.name);
      cases.push_back({name, options_of(method.value)});
      optim::LineSearchOptions& when = cases.back().options.minimizer.line_search;
      when.kind = search.value;
      if (search.value == LineSearchKind::kNone) continue;
      when.iterations = 4;
      when.on_rejection = true;
    }
  }
  add_each<LinearSolverKind>(
      "solver", [](auto& o, auto kind) { o.linear_solver.kind = kind; }, cases);
  add_each<linear::PreconditionerKind>(
      "preconditioner",
      [](auto& o, auto kind) {
        o.linear_solver.kind = LinearSolverKind::kIterative;
        o.linear_solver.preconditioner = kind;
      },
      cases);
  add_each<linear::Precision>(
      "precision", [](auto& o, auto p) { o.precision = p; }, cases);
  add_each<optim::Acceleration>(
      "acceleration", [](auto& o, auto a) { o.minimizer.acceleration = a; }, cases);
  add_each<optim::PointSteps>(
      "points", [](auto& o, auto p) { o.minimizer.point_steps = p; }, cases);
  add_each<linear::DampingMatrix>(
      "damping", [](auto& o, auto m) { o.minimizer.damping_matrix = m; }, cases);
  // Tukey's would take all of so far a start for outliers by the scale of its pixels.
  add_each<LossKind>(
      "loss",
      [](auto& o, auto loss) {
        o.loss = loss;
        if (o.is_robust()) o.loss_scale_px = 50.0;
      },
      cases);
  add_each<LossKind>(
      "auto_scale",
      [](auto& o, auto loss) {
        o.loss = loss == LossKind::kTukey ? LossKind::kHuber : loss;
        o.loss_scale_px = std::nullopt;
      },
      cases);
  return cases;
}

// Stages of loss 'auto', with points let go of on the way, and detours at their end.
std::vector<Case> falling_scales() {
  std::vector<Case> cases;
  for (Method method : {Method::kLevenbergMarquardtNielsen, Method::kDogLeg}) {
    cases.push_back({"falling_" + std::string(enum_name(method)), options_of(method)});
    cases.back().options.minimizer.termination.max_iterations = 60;
    cases.back().options.loss = LossKind::kAuto;
    cases.back().share_of_outliers = 0.2;
  }
  return cases;
}

class Resumed : public testing::TestWithParam<Case> {};

TEST_P(Resumed, EndsWithTheSameBitsWhereverItStood) {
  const Outcome whole = run(GetParam());
  ASSERT_FALSE(whole.stood.empty());
  for (const Resumption& stood : whole.stood) {
    SCOPED_TRACE("of " + std::to_string(whole.stood.size()) + " places");
    expect_same(run(GetParam(), &stood), whole);
  }
}

TEST_P(Resumed, EndsWithTheSameBitsAfterAnInterruptionWithinAStep) {
  Case c = GetParam();
  if (!facts_of(c.options.minimizer.method).solves_linear_system) return;
  c.options.linear_solver.kind = LinearSolverKind::kIterative;
  if (c.options.minimizer.acceleration == optim::Acceleration::kGeodesic) return;
  const Outcome whole = run(c);
  int polls = 0;
  optim::Events events;
  events.poll = [&] { return ++polls == 4 ? optim::Signal::kInterrupt : optim::Signal::kContinue; };
  const Outcome broken = run(c, nullptr, events);
  if (polls < 4) return;
  ASSERT_EQ(broken.summary.minimizer.termination, optim::Termination::kInterrupted);
  expect_same(run(c, &broken.stood.back()), whole);
}

constexpr auto kNameOfCase = [](const auto& test) { return support::identifier(test.param.name); };

INSTANTIATE_TEST_SUITE_P(All, Resumed, testing::ValuesIn(cases()), kNameOfCase);
INSTANTIATE_TEST_SUITE_P(FallingScale, Resumed, testing::ValuesIn(falling_scales()), kNameOfCase);

TEST(Resume, TheScaleOfLossAutoFallsOnTheWay) {
  for (const Case& c : falling_scales()) {
    Case begun = c;
    begun.options.minimizer.termination.max_iterations = 1;
    EXPECT_LT(run(c).summary.loss_scale_px, 0.5 * run(begun).summary.loss_scale_px);
  }
}

const Case kPlain{"", options_of(Method::kLevenbergMarquardtNielsen)};

TEST(Resume, LimitsAreForTheWholeRunAndMayBeRaised) {
  Case first = kPlain;
  first.options.minimizer.termination.max_iterations = 3;
  const Outcome begun = run(first);
  EXPECT_EQ(begun.summary.minimizer.termination, optim::Termination::kMaxIterations);
  expect_same(run(first, &begun.stood.back()), begun);
  expect_same(run(kPlain, &begun.stood.back()), run(kPlain));
}

// It has moved the state to its end: there is nothing to go on with but what was before it.
TEST(Resume, AStopAtTheLastIterationLeavesTheOneBefore) {
  Case c = kPlain;
  c.options.minimizer.termination = {};
  const Outcome whole = run(c);
  ASSERT_EQ(whole.summary.minimizer.termination, optim::Termination::kConverged);
  ASSERT_TRUE(whole.summary.minimizer.iterations.back().accepted);
  optim::Events events;
  events.on_iteration = [&](const Iteration& now) {
    return now.number == whole.summary.minimizer.iterations.back().number
               ? optim::Signal::kStop
               : optim::Signal::kContinue;
  };
  expect_same(run(c, &run(c, nullptr, events).stood.back()), whole);
}

TEST(Resume, ATimeLimitCountsTheSecondsBefore) {
  Resumption stood = run(kPlain).stood[2];
  stood.seconds = 3600.0;
  Case limited = kPlain;
  limited.options.minimizer.termination.max_seconds = 600.0;
  const Outcome outcome = run(limited, &stood);
  EXPECT_EQ(outcome.summary.minimizer.termination, optim::Termination::kMaxSeconds);
  EXPECT_EQ(outcome.summary.minimizer.iterations.size(), 3u);
  EXPECT_GT(outcome.summary.seconds_total, 3600.0);
}

// Each with its own part of the points.
std::vector<Outcome> run_on_ranks(const std::vector<Resumption>& resumed) {
  std::vector<Outcome> outcomes(2);
  support::play_ranks(2, [&](Exchange& exchange) {
    const support::OwnedProblem part = support::part_of(scene(kPlain.model), exchange.rank(), 2);
    Outcome& outcome = outcomes[exchange.rank()];
    outcome.state = state_of(part.view());
    optim::Events events;
    events.on_resumable = [&](const std::function<Resumption()>& where, bool) {
      outcome.stood.push_back(where());
    };
    outcome.summary = solve(part.view(),
                            kPlain.options,
                            events,
                            outcome.state,
                            exchange,
                            resumed.empty() ? nullptr : &resumed[exchange.rank()]);
  });
  return outcomes;
}

TEST(Resume, RanksGoOnTogether) {
  const std::vector<Outcome> whole = run_on_ranks({});
  ASSERT_FALSE(whole[0].stood.empty());
  for (std::size_t k = 0; k < whole[0].stood.size(); ++k) {
    const std::vector<Outcome> resumed = run_on_ranks({whole[0].stood[k], whole[1].stood[k]});
    for (int rank : {0, 1}) expect_same(resumed[rank], whole[rank]);
  }
}

TEST(Resume, RefusesWhatIsNotOfThisProblemAndTheseOptions) {
  const Resumption stood = run(kPlain).stood[2];
  Case other = kPlain;
  other.model = CameraModelId::kCalibrated;
  EXPECT_THROW(run(other, &stood), InvalidArgument);
  other = kPlain;
  other.options.minimizer.method = Method::kConjugateGradient;
  EXPECT_THROW(run(other, &stood), InvalidArgument);
  for (std::size_t size = 0; size < stood.numbers.size(); ++size) {
    Resumption shortened = stood;
    shortened.numbers.resize(size);
    EXPECT_THROW(run(kPlain, &shortened), InvalidArgument) << size;
  }
}

}  // namespace
}  // namespace sfmcpp::ba::resume_test

// An option that a method cannot heed is refused, with both names and the reason.
#include <algorithm>
#include <functional>
#include <limits>
#include <memory>
#include <ostream>

#include <gtest/gtest.h>

#include "sfmcpp/ba/solve.hpp"
#include "sfmcpp/core/error.hpp"
#include "sfmcpp/optim/minimizer.hpp"

namespace sfmcpp::ba::solve_options_test {
namespace {

using linear::LinearSolverKind;
using optim::LineSearchKind;
using optim::Method;

std::string refusal(const SolveOptions& options) {
  try {
    options.validate();
  } catch (const InvalidArgument& error) {
    return error.what();
  }
  return "legal";
}

SolveOptions with(Method method) {
  SolveOptions options;
  options.minimizer.method = method;
  return options;
}

struct Setting {
  const char* name;
  std::function<void(SolveOptions&)> set;
  std::vector<Method> heeded_by;
};
void PrintTo(const Setting& setting, std::ostream* out) { *out << setting.name; }

const std::vector<Method>& damped() {
  static const std::vector<Method> methods{
      Method::kLevenbergMarquardt, Method::kLevenbergMarquardtNielsen, Method::kAlternation};
  return methods;
}

const std::vector<Setting>& settings() {
  static const std::vector<Setting> all{
      {"initial_damping", [](SolveOptions& o) { o.minimizer.initial_damping = 0.1; }, damped()},
      {"initial_radius",
       [](SolveOptions& o) { o.minimizer.initial_radius = 2.0; },
       {Method::kDogLeg}},
      {"line_search_damping",
       [](SolveOptions& o) {
         o.minimizer.line_search.kind = LineSearchKind::kTwoWayAlgebraic;
         o.minimizer.line_search.damping_threshold = 1.0;
       },
       damped()},
      {"acceleration",
       [](SolveOptions& o) { o.minimizer.acceleration = optim::Acceleration::kPoints; },
       {Method::kLevenbergMarquardt, Method::kLevenbergMarquardtNielsen}},
      {"linear_solver",
       [](SolveOptions& o) { o.linear_solver.kind = LinearSolverKind::kSparse; },
       {Method::kLevenbergMarquardt,
        Method::kLevenbergMarquardtNielsen,
        Method::kDogLeg,
        Method::kGaussNewton}},
      {"damping_matrix",
       [](SolveOptions& o) { o.minimizer.damping_matrix = linear::DampingMatrix::kIdentity; },
       {Method::kLevenbergMarquardt,
        Method::kLevenbergMarquardtNielsen,
        Method::kDogLeg,
        Method::kGradientDescent,
        Method::kAlternation}}};
  return all;
}

class SettingOfAMethod : public testing::TestWithParam<Setting> {};

TEST_P(SettingOfAMethod, IsRefusedByNameWhereItCannotBeHeeded) {
  for (const auto& [method, name] : EnumNames<Method>::kTable) {
    SolveOptions options = with(method);
    GetParam().set(options);
    const auto& heeded = GetParam().heeded_by;
    const std::string message = refusal(options);
    if (std::find(heeded.begin(), heeded.end(), method) != heeded.end()) {
      EXPECT_EQ(message, "legal") << name;
    } else {
      EXPECT_EQ(message.find(GetParam().name), 0u) << message;
      EXPECT_NE(message.find("with method = '" + std::string(name) + "': "), std::string::npos)
          << message;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Settings,
                         SettingOfAMethod,
                         testing::ValuesIn(settings()),
                         [](const auto& test) { return std::string(test.param.name); });

TEST(SolveOptions, EveryMethodTakesEveryLineSearchAndDampingMatrix) {
  for (const auto& [method, method_name] : EnumNames<Method>::kTable) {
    for (const auto& [search, search_name] : EnumNames<LineSearchKind>::kTable) {
      SolveOptions options = with(method);
      options.minimizer.line_search.kind = search;
      EXPECT_EQ(refusal(options), "legal") << method_name << " " << search_name;
    }
  }
}

TEST(SolveOptions, TriggersWithoutALineSearchAreRefused) {
  SolveOptions rejected, damping;
  rejected.minimizer.line_search.on_rejection = true;
  damping.minimizer.line_search.damping_threshold = 1.0;
  EXPECT_EQ(refusal(rejected),
            "line_search = 'none': choose a line search to be used on rejected steps");
  EXPECT_EQ(refusal(damping),
            "line_search = 'none': choose a line search to be used above line_search_damping");
}

TEST(SolveOptions, ATestOfBacktrackingIsRefusedWithoutIt) {
  SolveOptions options;
  options.minimizer.line_search.backtracking_test = optim::BacktrackingTest::kGoldstein;
  EXPECT_EQ(
      refusal(options),
      "backtracking_test = 'goldstein' with line_search = 'none': only 'backtracking' has a test");
  options.minimizer.line_search.kind = LineSearchKind::kBacktracking;
  EXPECT_EQ(refusal(options), "legal");
}

TEST(SolveOptions, WeightsOfAnAlgebraicCostAreRefusedWithoutASearchThatHasIt) {
  for (const auto& [search, name] : EnumNames<LineSearchKind>::kTable) {
    SolveOptions options;
    options.algebraic_weights = AlgebraicWeights::kInverseDepth;
    options.minimizer.line_search.kind = search;
    const bool algebraic = name == "g-als" || name == "t-als";
    EXPECT_EQ(refusal(options) == "legal", algebraic) << name;
  }
}

// Who compares losses, searches or solvers keeps their numbers.
TEST(SolveOptions, NumbersOfALossASearchOrASolverMayBeGivenWhereAnotherIsTaken) {
  using Kind = linear::LinearSolverKind;
  for (Kind kind : {Kind::kAuto, Kind::kDense, Kind::kSparse, Kind::kIterative}) {
    SolveOptions options;
    options.linear_solver.kind = kind;
    options.linear_solver.preconditioner = linear::PreconditionerKind::kTwoLevels;
    options.linear_solver.pcg_tolerance = 0.1;
    options.loss_scale_px = 2.0;
    options.minimizer.line_search.iterations = 3;
    EXPECT_EQ(refusal(options), "legal") << enum_name(kind);
  }
}

TEST(SolveOptions, AStepIsBentOrSearchedAlong) {
  SolveOptions options;
  options.minimizer.acceleration = optim::Acceleration::kGeodesic;
  EXPECT_EQ(refusal(options), "legal");
  options.minimizer.line_search.kind = LineSearchKind::kSoft;
  EXPECT_NE(refusal(options).find("acceleration = 'geodesic' with line_search = 'soft': "),
            std::string::npos);
  options.minimizer.acceleration = optim::Acceleration::kAuto;
  EXPECT_EQ(refusal(options), "legal");
}

TEST(SolveOptions, OnlyADirectSolverBendsThePathsOfCameras) {
  SolveOptions options;
  options.minimizer.acceleration = optim::Acceleration::kGeodesic;
  options.linear_solver.kind = linear::LinearSolverKind::kIterative;
  EXPECT_EQ(refusal(options),
            "acceleration = 'geodesic' with linear_solver = 'iterative': it keeps no factors to "
            "solve for the cameras again; choose 'points'");
  options.linear_solver.kind = linear::LinearSolverKind::kSparse;
  EXPECT_EQ(refusal(options), "legal");
  options.minimizer.acceleration = optim::Acceleration::kPoints;
  options.linear_solver.kind = linear::LinearSolverKind::kIterative;
  EXPECT_EQ(refusal(options), "legal");
}

TEST(SolveOptions, ATableAndAKindOfLossAreRefused) {
  SolveOptions options;
  options.loss = LossKind::kHuber;
  options.loss_table = std::make_shared<LossTable>(
      "squares", std::vector{0.0, 1.0}, std::vector{1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0});
  EXPECT_EQ(refusal(options),
            "loss = 'huber' with a loss_table, which takes its place: leave 'squared'");
  options.loss = LossKind::kSquared;
  EXPECT_EQ(refusal(options), "legal");
}

TEST(SolveOptions, NumbersOfTheLineSearchOutOfRangeAreNamed) {
  SolveOptions options;
  options.minimizer.line_search.iterations = -1;
  options.minimizer.line_search.damping_threshold = -0.5;
  options.minimizer.initial_radius = std::numeric_limits<double>::infinity();
  const std::string message = refusal(options);
  for (const char* violation : {"line_search_iterations = -1: must be at least 0",
                                "line_search_damping = -0.5: must be at least 0",
                                "initial_radius = inf: must be positive and finite"}) {
    EXPECT_NE(message.find(violation), std::string::npos) << message;
  }
}

TEST(SolveOptions, ALineSearchThatWouldNeverSearchIsRefused) {
  SolveOptions options;
  optim::LineSearchOptions& search = options.minimizer.line_search;
  search.iterations = 0;
  EXPECT_EQ(refusal(options), "legal") << "there is none";
  search.kind = LineSearchKind::kGlobalAlgebraic;
  EXPECT_EQ(refusal(options),
            "line_search_iterations = 0 with line_search = 'g-als': it would never search; choose "
            "line_search_on_rejection, line_search_damping or 'none'");
  search.on_rejection = true;
  EXPECT_EQ(refusal(options), "legal");
  search = {.kind = LineSearchKind::kGlobalAlgebraic, .iterations = 0, .damping_threshold = 1e-4};
  EXPECT_EQ(refusal(options), "legal");
}

TEST(SolveOptions, NumbersThatAreNoEnumeratorsAreRefused) {
  SolveOptions options;
  options.loss = static_cast<LossKind>(99);
  EXPECT_EQ(refusal(options), "loss = 99: is none of its values");
  options = with(static_cast<Method>(-1));
  EXPECT_EQ(refusal(options), "method = -1: is none of its values");
  options = {};
  options.linear_solver.kind = static_cast<LinearSolverKind>(99);
  EXPECT_EQ(refusal(options), "linear_solver = 99: is none of its values");
}

TEST(SolveOptions, PointsAreRefittedWhereNothingIsSearched) {
  const auto of = [](const SolveOptions& o) { return optim::point_steps_of(o.minimizer); };
  SolveOptions options = with(Method::kLevenbergMarquardt);
  EXPECT_EQ(of(options), optim::PointSteps::kRefitted);
  options.minimizer.point_steps = optim::PointSteps::kHeldBack;
  EXPECT_EQ(of(options), optim::PointSteps::kHeldBack);
  options.minimizer.point_steps = optim::PointSteps::kAuto;
  options.minimizer.line_search.kind = LineSearchKind::kTwoWayAlgebraic;
  EXPECT_EQ(of(options), optim::PointSteps::kWhole);
  EXPECT_EQ(of(with(Method::kGradientDescent)), optim::PointSteps::kWhole);
}

}  // namespace
}  // namespace sfmcpp::ba::solve_options_test

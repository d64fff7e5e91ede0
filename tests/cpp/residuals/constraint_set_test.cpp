// Groups of constraints: what they cost, their weights, and what is refused.
#include "sfmcpp/residuals/constraint_set.hpp"

#include <cmath>
#include <functional>
#include <limits>

#include <gtest/gtest.h>

#include "sfmcpp/ba/constraint_terms.hpp"
#include "support/random_constraints.hpp"
#include "support/refusal.hpp"

namespace sfmcpp::residuals::constraint_set_test {
namespace {

using support::expect_refused;
using support::OwnedProblem;
using Kind = ConstraintKind;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

OwnedProblem scene(CameraModelId model = CameraModelId::kPerspective) {
  support::SceneOptions options = support::perturbed(model);
  options.free_intrinsics =
      model == CameraModelId::kPerspective ? std::vector<int>{0, 2, 3} : std::vector<int>{};
  return make_circle_scene(options);
}

class ConstraintSetOf : public testing::TestWithParam<ConstraintKind> {
 protected:
  ConstraintGroup group(std::vector<std::pair<int, int>> cameras = {{0, 1}, {3, 2}}) const {
    return random_group(problem, GetParam(), cameras);
  }
  ConstrainedCameras cameras() const { return constrained_cameras(problem.view(), state); }
  double cost_of(const ConstraintGroup& g) const {
    ConstraintSet set;
    set.add(g);
    return set.cost(cameras());
  }

  OwnedProblem problem = scene();
  optim::State state = ba::state_of(problem.view());
};

TEST_P(ConstraintSetOf, CostIsHalfTheWeightedSumOfTheMembersMeanSquaredErrors) {
  const ConstraintGroup all = group();
  double expected = 0.0;
  for (const ConstraintMember& member : all.members) {
    ConstraintGroup alone = all;
    alone.weight = 1.0;
    alone.members = {member};
    alone.members[0].weight = 1.0;
    const double mean_squared_error = 2.0 * cost_of(alone);
    EXPECT_GT(mean_squared_error, 0.0);
    expected += 0.5 * all.weight * member.weight * mean_squared_error;
  }
  EXPECT_NEAR(cost_of(all) / expected, 1.0, 1e-12);
}

TEST_P(ConstraintSetOf, ErrorIsThatOfTheSingleConstraint) {
  ConstraintGroup alone = group({{0, 1}});
  alone.weight = alone.members[0].weight = 1.0;
  if (!facts_of(GetParam()).is_on_poses()) {
    const double* row = cameras().intrinsics_of(1);
    const int first = GetParam() == Kind::kFocal ? 0 : 2;
    const auto e = evaluate(GetParam(), row + first, alone.members[0].intrinsics.data());
    const double squared = e.residual[0] * e.residual[0] + e.residual[1] * e.residual[1];
    EXPECT_NEAR(2.0 * cost_of(alone) / squared, 1.0, 1e-12);
    return;
  }
  PoseConstraint constraint = alone.members[0].pose;
  constraint.kind = GetParam();
  constraint.points = alone.members[0].points;
  Eigen::VectorXd e(residual_size(constraint));
  evaluate(constraint, cameras().pose(1), cameras().pose(0), {e.data()});
  EXPECT_NEAR(2.0 * cost_of(alone) / e.squaredNorm(), 1.0, 1e-12);
}

TEST_P(ConstraintSetOf, SetWeightIsAsIfTheGroupHadBeenMadeWithIt) {
  ConstraintSet set;
  set.add(group());
  ConstraintGroup other = group();
  other.name = "other";
  set.add(other);
  set.set_weight("other", 7.0);
  other.weight = 7.0;
  const std::vector<double> costs = set.costs(cameras());
  ASSERT_EQ(costs.size(), 2u);
  EXPECT_EQ(costs[0], cost_of(group()));
  EXPECT_EQ(costs[1], cost_of(other));
  EXPECT_EQ(set.cost(cameras()), costs[0] + costs[1]);
}

TEST_P(ConstraintSetOf, AMemberIsActiveIfItHasAWeightInAGroupThatHasOne) {
  ConstraintGroup g = group();
  EXPECT_TRUE(is_active(g, g.members[0]));
  g.members[1].weight = 0.0;
  EXPECT_FALSE(is_active(g, g.members[1]));
  EXPECT_TRUE(is_active(g, g.members[0]));
  g.weight = 0.0;
  EXPECT_FALSE(is_active(g, g.members[0]));
}

TEST_P(ConstraintSetOf, WithoutWeightAConstraintThatIsNotFiniteCostsNothing) {
  ConstraintSet set;
  set.add(group());
  set.set_weight(set.groups()[0].name, 0.0);
  state.cameras.assign(state.cameras.size(), kNan);
  state.intrinsics.assign(state.intrinsics.size(), kNan);
  EXPECT_EQ(set.cost(cameras()), 0.0);
  set.set_weight(set.groups()[0].name, 1.0);
  EXPECT_TRUE(std::isnan(set.cost(cameras())));
}

TEST_P(ConstraintSetOf, CamerasOutOfRangeAreRefusedByNameAndPosition) {
  ConstraintSet set;
  ConstraintGroup bad = group();
  bad.members[1].camera = 6;
  set.add(bad);
  expect_refused([&] { set.check(cameras()); },
                 {"constraints['" + bad.name + "'][1]", "camera 6: must be in [0, 6)"});
}

TEST_P(ConstraintSetOf, WhatTheTruthFulfilsPassesTheCheck) {
  ConstraintSet set;
  set.add(group());
  EXPECT_NO_THROW(set.check(cameras()));
}

TEST_P(ConstraintSetOf, ProjectiveCamerasAreRefused) {
  ConstraintSet set;
  set.add(group());
  const OwnedProblem projective = scene(CameraModelId::kProjective);
  const optim::State start = ba::state_of(projective.view());
  expect_refused([&] { set.check(constrained_cameras(projective.view(), start)); },
                 {set.groups()[0].name, "'projective'", "metric"});
}

TEST_P(ConstraintSetOf, BrokenWeightsAreRefusedByName) {
  for (double weight : {-1.0, kNan, std::numeric_limits<double>::infinity()}) {
    ConstraintGroup bad = group();
    bad.weight = weight;
    expect_refused([&] { cost_of(bad); }, {"'].weight = "});
    bad = group();
    bad.members[1].weight = weight;
    expect_refused([&] { cost_of(bad); }, {"'][1].weight = "});
  }
}

TEST_P(ConstraintSetOf, TheNumberOfCamerasGoesWithTheKind) {
  ConstraintGroup bad = group();
  const bool two = bad.members[0].previous != kNoPrevious;
  if (!two && !facts_of(GetParam()).is_on_poses()) return;
  bad.members[0].previous = two ? kNoPrevious : 0;
  expect_refused([&] { cost_of(bad); },
                 {"'" + std::string(enum_name(GetParam())) + "'",
                  two ? "two cameras, one is given" : "one camera, two are given"});
}

TEST_P(ConstraintSetOf, AWeightForEachEntryGoesWithTheEntries) {
  ConstraintGroup g = group();
  g.members[1].pose.kind = GetParam();
  const auto entries = facts_of(GetParam()).is_on_poses()
                           ? static_cast<std::size_t>(residual_size(measurement_of(g.members[1])))
                           : static_cast<std::size_t>(facts_of(GetParam()).entries);
  for (std::size_t given : {entries - 1, entries + 1, 2 * entries}) {
    if (given == 0) continue;
    g.members[1].entry_weights.assign(given, 1.0);
    expect_refused([&] { cost_of(g); },
                   {"'][1].weight: one for each of " + std::to_string(given) + " entries, has " +
                    std::to_string(entries)});
  }
  g.members[1].entry_weights.assign(entries, 1.0);
  EXPECT_DOUBLE_EQ(cost_of(g), cost_of(group()));
}

INSTANTIATE_TEST_SUITE_P(Kinds,
                         ConstraintSetOf,
                         testing::ValuesIn(support::all_constraint_kinds()),
                         [](const auto& test) { return support::identifier_of(test.param); });

class RefusedConstraint : public testing::Test {
 protected:
  void add(ConstraintKind kind, const std::function<void(ConstraintGroup&)>& change) {
    ConstraintGroup group = random_group(problem, kind, {{0, 1}, {3, 2}});
    change(group);
    set.add(group);
  }
  void check() { set.check(constrained_cameras(problem.view(), state_of(problem.view()))); }

  OwnedProblem problem = scene();
  ConstraintSet set;
};

TEST_F(RefusedConstraint, NamesAreUniqueAndNotEmpty) {
  add(Kind::kPosition, [](auto& g) { g.name = "gps"; });
  expect_refused([&] { add(Kind::kScale, [](auto& g) { g.name = "gps"; }); },
                 {"constraints['gps']: two groups"});
  expect_refused([&] { add(Kind::kScale, [](auto& g) { g.name.clear(); }); }, {"empty name"});
  expect_refused([&] { set.set_weight("gsp", 1.0); }, {"constraints['gsp']: no group"});
}

TEST_F(RefusedConstraint, MeasurementsThatCannotBeOneAreNamed) {
  expect_refused(
      [&] { add(Kind::kPosition, [](auto& g) { g.members[1].pose.translation[2] = kNan; }); },
      {"constraints['position'][1].translation: must be finite"});
  expect_refused(
      [&] { add(Kind::kOrientation, [](auto& g) { g.members[0].pose.rotation *= -1.0; }); },
      {"constraints['orientation'][0].rotation: must be a rotation"});
  expect_refused([&] { add(Kind::kScale, [](auto& g) { g.members[0].pose.distance = -1.0; }); },
                 {"constraints['scale'][0].distance"});
  expect_refused(
      [&] { add(Kind::kSmoothingReprojections, [](auto& g) { g.members[0].points.clear(); }); },
      {"constraints['smoothing-reprojections'][0].points"});
  expect_refused(
      [&] { add(Kind::kSmoothingReprojections, [](auto& g) { g.members[1].points.pop_back(); }); },
      {"constraints['smoothing-reprojections'][1].points: must have three numbers for each"});
  expect_refused([&] { add(Kind::kFocal, [](auto& g) { g.members[0].intrinsics[0] = 0.0; }); },
                 {"constraints['focal'][0] = 0.000000: a focal length must be positive"});
  expect_refused(
      [&] { add(Kind::kPrincipalPoint, [](auto& g) { g.members[1].intrinsics[1] = kNan; }); },
      {"constraints['principal-point'][1]: must be finite"});
}

TEST_F(RefusedConstraint, NumbersThatAreNoKindAndNoLossAreNamed) {
  for (int number : {-1, 99}) {
    const std::string told = " = " + std::to_string(number) + ": is none of its values";
    expect_refused(
        [&] { add(Kind::kPosition, [&](auto& g) { g.kind = static_cast<Kind>(number); }); },
        {"constraints['position'].kind" + told});
    expect_refused(
        [&] {
          add(Kind::kPosition, [&](auto& g) { g.loss.kind = static_cast<LossKind>(number); });
        },
        {"constraints['position'].loss.kind" + told});
  }
}

// One residual, of what it is given.
class FirstNumber final : public ResidualFunction {
 public:
  int rows() const override { return 1; }
  void evaluate(const double* poses, const double*, const Output& out) const override {
    *out.residuals = *poses;
  }
};

TEST_F(RefusedConstraint, AFunctionIsNotAskedAboutNoMembers) {
  add(Kind::kPosition, [](auto& g) {
    g.function = std::make_shared<FirstNumber>();
    g.members.clear();
  });
  EXPECT_NO_THROW(check());
  EXPECT_EQ(set.cost(constrained_cameras(problem.view(), state_of(problem.view()))), 0.0);
}

TEST_F(RefusedConstraint, ACameraIsNotComparedWithItself) {
  expect_refused([&] { add(Kind::kScale, [](auto& g) { g.members[0].previous = 1; }); },
                 {"constraints['scale'][0].cameras: camera 1 twice"});
}

TEST_F(RefusedConstraint, FrozenPointsMustBeInFrontOfTheCamera) {
  add(Kind::kOrientationReprojections, [&](auto& g) {
    const double* pose = problem.cameras.data() + 12;
    for (int k = 0; k < 3; ++k)  // a metre behind the centre, along the third column
      g.members[0].points[6 + k] = pose[4 * k + 3] - pose[4 * k + 2];
  });
  expect_refused([&] { check(); },
                 {"constraints['orientation-reprojections'][0].points[2]: depth -1.0"});
}

TEST_F(RefusedConstraint, FrozenPointsMustBeInFrontOfTheMeasuredCameraToo) {
  add(Kind::kOrientationReprojections, [&](auto& g) {
    const double* pose = problem.cameras.data() + 12;
    for (int row = 0; row < 3; ++row)  // as the camera is, but for half a turn about its y axis
      for (int column = 0; column < 3; ++column)
        g.members[0].pose.rotation(row, column) =
            (column == 1 ? 1.0 : -1.0) * pose[4 * row + column];
  });
  expect_refused([&] { check(); },
                 {"constraints['orientation-reprojections'][0].points[0]: depth -"});
}

TEST_F(RefusedConstraint, IntrinsicsThatTheCameraModelHasNotAreRefused) {
  add(Kind::kPrincipalPoint, [](auto&) {});
  for (CameraModelId model : {CameraModelId::kCalibrated, CameraModelId::kBal}) {
    problem = scene(model);
    expect_refused([&] { check(); }, {"'principal-point'", std::string(enum_name(model))});
  }
}

TEST_F(RefusedConstraint, TheLogarithmOfAFocalLengthNeedsAPositiveOne) {
  add(Kind::kFocal, [](auto&) {});
  problem.intrinsics[12] = -800.0;
  expect_refused([&] { check(); }, {"camera 1 has f = -800"});
}

TEST_F(RefusedConstraint, SharedIntrinsicsAreNotComparedWithThemselves) {
  add(Kind::kFocal, [](auto& g) { g.members[0].previous = 0; });
  EXPECT_NO_THROW(check());
  problem.intrinsics_index[1] = 0;
  expect_refused([&] { check(); }, {"share their intrinsics"});
}

TEST(ConstraintKindNames, EveryNameIsParsedBackAndOthersAreRefusedWithTheList) {
  EXPECT_EQ(EnumNames<Kind>::kTable.size(), 13u);
  for (const auto& [kind, name] : EnumNames<Kind>::kTable) EXPECT_EQ(parse_enum<Kind>(name), kind);
  expect_refused([] { parse_enum<Kind>("gps"); }, {"kind = 'gps'", "position", "focal"});
}

}  // namespace
}  // namespace sfmcpp::residuals::constraint_set_test

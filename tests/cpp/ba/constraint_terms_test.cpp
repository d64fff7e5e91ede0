// The cost with constraints and its derivatives, for every kind; and what a problem cannot have.
#include "sfmcpp/ba/constraint_terms.hpp"

#include <gtest/gtest.h>

#include "sfmcpp/ba/solve.hpp"
#include "sfmcpp/linear/step_algebra.hpp"
#include "sfmcpp/math/numeric_diff.hpp"
#include "support/dense_reference.hpp"
#include "support/random_constraints.hpp"
#include "support/refusal.hpp"

namespace sfmcpp::ba::constraint_terms_test {
namespace {

using Eigen::VectorXd;
using linear::Step;
using optim::State;
using support::expect_refused;
using support::LinearizedProblem;
using support::OwnedProblem;
using Kind = residuals::ConstraintKind;

OwnedProblem scene() {
  support::SceneOptions options = support::perturbed(CameraModelId::kPerspective);
  options.num_points = 20;
  options.num_groups = 3;
  options.free_intrinsics = std::vector<int>{0, 2, 3};
  OwnedProblem result = make_circle_scene(options);
  result.fixed_cameras[2] = result.fixed_points[5] = 1;
  return result;
}

struct KindAndLoss {
  residuals::ConstraintKind kind;
  LossKind loss;
};

std::vector<KindAndLoss> kinds_and_losses() {
  std::vector<KindAndLoss> result;
  for (auto kind : support::all_constraint_kinds()) result.push_back({kind, LossKind::kSquared});
  for (LossKind loss : {LossKind::kHuber, LossKind::kCauchy, LossKind::kTukey}) {
    for (auto kind : {Kind::kPosition, Kind::kDisplacementPose, Kind::kFocal})
      result.push_back({kind, loss});
  }
  return result;
}

class ConstraintTermsOf : public testing::TestWithParam<KindAndLoss> {
 protected:
  static OwnedProblem constrained() {
    OwnedProblem result = scene();
    residuals::ConstraintGroup group =
        random_group(result, GetParam().kind, {{0, 1}, {1, 4}, {2, 3}, {5, 2}});
    // Relative to the intrinsics of another row (thesis table 5.1: f of the previous camera).
    if (!facts_of(GetParam().kind).is_on_poses()) group.members[1].previous = 3;
    group.weight = 1e6;
    // Errors are 30 to 150 of these units; Tukey's loss would not see any beyond its scale.
    const double scale = GetParam().loss == LossKind::kTukey ? 300.0 : 40.0;
    group.loss = {GetParam().loss, scale};
    result.constraints.add(group);
    return result;
  }
  double cost_at(const VectorXd& delta) {
    Step step;
    step.camera.assign(delta.begin(), delta.begin() + work.map.num_columns);
    step.point.assign(delta.begin() + work.map.num_columns, delta.end());
    State candidate = work.state;
    work.model.plus(work.state, step, {}, candidate);
    return work.model.cost(candidate);
  }

  LinearizedProblem work{constrained()};
};

TEST_P(ConstraintTermsOf, RightHandSideIsTheNegativeGradientOfTheTotalCost) {
  const Step b = linear::negative_gradient(work.normal());
  VectorXd analytic(static_cast<Eigen::Index>(b.camera.size() + b.point.size()));
  std::copy(b.camera.begin(), b.camera.end(), analytic.begin());
  std::copy(b.point.begin(), b.point.end(), analytic.begin() + work.map.num_columns);
  const auto cost = [&](const VectorXd& delta) -> VectorXd {
    return VectorXd::Constant(1, cost_at(delta));
  };
  VectorXd numeric =
      numeric_jacobian(cost, VectorXd::Constant(analytic.size(), 1e-4)).row(0).transpose();
  for (std::size_t p = 0; p < work.map.free_point.size(); ++p) {
    if (!work.map.free_point[p]) numeric.segment<3>(work.map.num_columns + 3 * p).setZero();
  }
  EXPECT_LT((numeric + analytic).norm(), 1e-8 * analytic.norm());
}

TEST_P(ConstraintTermsOf, ConstraintsChangeTheGradientByMoreThanItIsCheckedTo) {
  const LinearizedProblem without(scene());
  const VectorXd b =
      Eigen::Map<const VectorXd>(work.normal().camera_rhs().data(), work.map.num_columns);
  const VectorXd b0 =
      Eigen::Map<const VectorXd>(without.normal().camera_rhs().data(), work.map.num_columns);
  EXPECT_GT((b - b0).norm(), 5e-5 * b.norm());
}

TEST_P(ConstraintTermsOf, SlopeAlongAStepIsTheDerivativeOfTheCost) {
  Step step = support::random_step(work.map, 8);
  linear::scale(work.normal(), 0.01, step);
  const auto candidate = [&](double length) {
    State result = work.state;
    work.model.plus(work.state, step, {length, length}, result);
    return result;
  };
  for (double length : {0.0, 0.4, 1.0}) {
    const auto cost = [&](const VectorXd& further) -> VectorXd {
      return VectorXd::Constant(1, work.model.cost(candidate(length + further[0])));
    };
    const double numeric = numeric_jacobian(cost, VectorXd::Constant(1, 1e-4))(0, 0);
    const double slope = work.model.slope(work.state, step, candidate(length));
    EXPECT_NEAR(slope / numeric, 1.0, 1e-6) << "at " << length;
  }
}

TEST_P(ConstraintTermsOf, AnotherWeightIsTakenUpByTheNextLinearisation) {
  const std::string name = work.owned.constraints.groups()[0].name;
  work.owned.constraints.set_weight(name, 3e5);
  work.model.linearize(work.state);
  OwnedProblem other = constrained();
  other.constraints.set_weight(name, 3e5);
  LinearizedProblem anew(other);
  EXPECT_EQ(work.normal().camera_rhs(), anew.normal().camera_rhs());
  EXPECT_EQ(work.normal().camera_diagonal(), anew.normal().camera_diagonal());
  EXPECT_EQ(work.model.cost(work.state), anew.model.cost(anew.state));
}

TEST_P(ConstraintTermsOf, RobustLossLeavesConstraintsAlone) {
  const double constraints = work.model.constraints().cost(work.state);
  EXPECT_GT(constraints, 0.0);
  LinearizedProblem without(scene());
  for (LossKind kind : {LossKind::kSquared, LossKind::kTukey}) {
    work.model.set_loss({kind, 2.0});
    without.model.set_loss({kind, 2.0});
    const double total = work.model.cost(work.state);
    EXPECT_NEAR(total - without.model.cost(work.state), constraints, 1e-9 * total);
  }
}

INSTANTIATE_TEST_SUITE_P(Kinds,
                         ConstraintTermsOf,
                         testing::ValuesIn(kinds_and_losses()),
                         [](const auto& test) {
                           const std::string kind = support::identifier_of(test.param.kind);
                           return kind + "_" + std::string(enum_name(test.param.loss));
                         });

class RefusedProblem : public testing::Test {
 protected:
  void constrain(residuals::ConstraintKind kind, std::vector<std::pair<int, int>> cameras) {
    problem.constraints.add(random_group(problem, kind, cameras));
  }
  void solve_it() {
    State state = state_of(problem.view());
    solve(problem.view(), {}, {}, state);
  }
  void take_observations_from(int camera) {
    const OwnedProblem all = problem;
    problem.camera_index.clear();
    problem.point_index.clear();
    problem.pixels.clear();
    for (std::size_t k = 0; k < all.camera_index.size(); ++k) {
      if (all.camera_index[k] != camera)
        problem.observe(
            all.camera_index[k], all.point_index[k], all.pixels[2 * k], all.pixels[2 * k + 1]);
    }
  }

  OwnedProblem problem = scene();
};

TEST_F(RefusedProblem, CamerasOutOfRange) {
  residuals::ConstraintGroup group = random_group(problem, Kind::kScale, {{0, 1}});
  group.members[0].previous = -3;
  problem.constraints.add(group);
  expect_refused([&] { solve_it(); }, {"constraints['scale'][0].cameras: camera -3"});
}

TEST_F(RefusedProblem, IntrinsicsThatAreFixed) {
  constrain(Kind::kPrincipalPoint, {{0, 1}, {0, 2}});
  EXPECT_NO_THROW(solve_it());
  problem.fixed_intrinsics[2 * 12 + 3] = 1;  // cy of the row of camera 2
  expect_refused([&] { solve_it(); },
                 {"constraints['principal-point'][1]: camera 2 keeps its cy", "free"});
}

TEST_F(RefusedProblem, TwoCamerasOfWhichOneIsNeitherObservedNorDeterminedNorFixed) {
  take_observations_from(3);
  constrain(Kind::kPosition, {{0, 3}});
  EXPECT_NO_THROW(solve_it());
  constrain(Kind::kScale, {{0, 1}, {3, 4}});
  expect_refused([&] { solve_it(); },
                 {"constraints['scale'][1].cameras: camera 3 has no observations",
                  "must be observed, fixed or constrained further"});
  problem.fixed_cameras[3] = 1;
  EXPECT_NO_THROW(solve_it());
}

TEST_F(RefusedProblem, LossOfAGroupWithoutAScale) {
  residuals::ConstraintGroup group = random_group(problem, Kind::kScale, {{0, 1}});
  group.loss = {LossKind::kHuber, 0.0};
  expect_refused([&] { problem.constraints.add(group); },
                 {"constraints['scale'].loss_scale", "positive"});
}

}  // namespace
}  // namespace sfmcpp::ba::constraint_terms_test

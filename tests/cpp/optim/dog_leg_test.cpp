// The path of the Dog-Leg against dense algebra, and the rules of its radius.
#include <cmath>

#include <Eigen/Core>
#include <gtest/gtest.h>

#include "sfmcpp/optim/step_strategy.hpp"
#include "support/dense_reference.hpp"

namespace sfmcpp::optim::dog_leg_test {
namespace {

using Eigen::VectorXd;
using linear::Damping;
using linear::DampingMatrix;
using linear::LinearSolver;

// Solves, counts and fails to order.
class ObservedSolver final : public LinearSolver {
 public:
  explicit ObservedSolver(const linear::NormalEquations& normal)
      : solver_(linear::make_linear_solver(normal, {linear::LinearSolverKind::kDense})) {}

  linear::LinearSolveResult solve(const Damping& damping,
                                  linear::Step& step,
                                  const std::function<bool()>& should_stop) override {
    dampings.push_back(damping.lambda);
    if (failures_to_come > 0) {
      --failures_to_come;
      return {};
    }
    return solver_->solve(damping, step, should_stop);
  }

  std::vector<double> dampings;
  int failures_to_come = 0;

 private:
  std::unique_ptr<LinearSolver> solver_;
};

class DogLeg : public testing::TestWithParam<DampingMatrix> {
 protected:
  struct Result {
    VectorXd step;
    StepResult result;
  };

  std::unique_ptr<StepStrategy> strategy(std::optional<double> radius) const {
    MinimizerOptions options;
    options.method = Method::kDogLeg;
    options.damping_matrix = GetParam();
    options.initial_radius = radius;
    return make_dog_leg(options);
  }
  Result compute(StepStrategy& strategy) {
    linear::Step step;
    const StepResult result = strategy.compute(
        linearized.normal(), solver, [] { return false; }, step);
    return {flatten(dense, step), result};
  }
  Result at_radius(double radius) { return compute(*strategy(radius)); }

  double norm(const VectorXd& step) const {
    return std::sqrt(step.cwiseAbs2().dot(damping_diagonal(dense, {1.0, GetParam()}).cwiseAbs()));
  }
  VectorXd cauchy_step() const {
    const VectorXd b = dense.jacobian.transpose() * dense.residual;
    const VectorXd d = b.cwiseQuotient(damping_diagonal(dense, {1.0, GetParam()}));
    return b.dot(d) / (dense.jacobian * d).squaredNorm() * d;
  }
  VectorXd gauss_newton_step() const {
    return solve_by_qr(dense, {1e-6, DampingMatrix::kDiagonal});
  }
  static double distance(const VectorXd& a, const VectorXd& b) { return (a - b).norm() / b.norm(); }
  // `share` of the way from the Cauchy to the Gauss–Newton radius.
  double radius_between(double share) const {
    return (1.0 - share) * norm(cauchy_step()) + share * norm(gauss_newton_step());
  }

  support::LinearizedProblem linearized{
      support::make_circle_scene(support::perturbed(CameraModelId::kBal)), true};
  support::DenseSystem dense = make_dense_system(linearized);
  ObservedSolver solver{linearized.normal()};
};

TEST_P(DogLeg, ALargeRadiusGivesTheGaussNewtonStep) {
  EXPECT_LT(distance(at_radius(1e15).step, gauss_newton_step()), 1e-8);
}

TEST_P(DogLeg, ASmallRadiusGivesThatMuchOfTheCauchyStep) {
  const VectorXd cauchy = cauchy_step();
  for (double share : {1e-6, 0.3, 0.999}) {
    EXPECT_LT(distance(at_radius(share * norm(cauchy)).step, share * cauchy), 1e-10);
  }
  EXPECT_LT(distance(at_radius(norm(cauchy)).step, cauchy), 1e-6);
}

TEST_P(DogLeg, BetweenTheTwoTheStepHasTheLengthOfTheRadiusAndLiesOnTheSecondLeg) {
  const VectorXd cauchy = cauchy_step(), leg = gauss_newton_step() - cauchy;
  for (double share : {0.01, 0.5, 0.99}) {
    const double radius = radius_between(share);
    const VectorXd step = at_radius(radius).step;
    EXPECT_NEAR(norm(step) / radius, 1.0, 1e-10);
    const double t = (step - cauchy).dot(leg) / leg.squaredNorm();
    EXPECT_GT(t, 0.0);
    EXPECT_LT(t, 1.0);
    EXPECT_LT(distance(step, cauchy + t * leg), 1e-7);
  }
}

TEST_P(DogLeg, ALargerRadiusLowersTheModelMoreAndThePredictionIsThatOfTheDenseModel) {
  double previous = 0.0;
  for (double radius : {0.1 * radius_between(0.0),
                        radius_between(0.0),
                        radius_between(0.2),
                        radius_between(0.8),
                        2.0 * radius_between(1.0)}) {
    const Result now = at_radius(radius);
    const double decrease = model_decrease(dense, now.step);
    EXPECT_GT(decrease, previous);
    EXPECT_NEAR(now.result.predicted_decrease / decrease, 1.0, 1e-7);
    previous = decrease;
  }
}

TEST_P(DogLeg, FirstRadiusIsOneOrTenCauchySteps) {
  const VectorXd step = compute(*strategy(std::nullopt)).step;
  const bool identity = GetParam() == DampingMatrix::kIdentity;
  const double radius = identity ? 1.0 : 10.0 * norm(cauchy_step());
  EXPECT_NEAR(norm(step) / std::min(radius, norm(gauss_newton_step())), 1.0, 1e-7);
}

// All radii are far below the Gauss–Newton step, so that the length of a step tells its radius.
TEST_P(DogLeg, TheRadiusFollowsTheGain) {
  double radius = 1e-4 * norm(cauchy_step());
  const auto dog_leg = strategy(radius);
  const auto expect_radius = [&](double expected) {
    EXPECT_NEAR(norm(compute(*dog_leg).step) / expected, 1.0, 1e-9);
  };
  expect_radius(radius);
  for (const auto& [gain, factor] :
       {std::pair{0.76, 3.0}, {5.0, 3.0}, {0.75, 1.0}, {0.25, 1.0}, {0.24, 0.5}, {0.01, 0.5}}) {
    dog_leg->accepted(gain);
    expect_radius(radius *= factor);
  }
  dog_leg->rejected();
  expect_radius(radius *= 0.5);
}

TEST_P(DogLeg, AGoodStepWellWithinTheRadiusLeavesIt) {
  const double length = norm(gauss_newton_step());
  const auto dog_leg = strategy(100.0 * length);
  compute(*dog_leg);
  dog_leg->accepted(1.0);
  for (int k = 0; k < 7; ++k) {  // 100 / 2⁶ > 1 > 100 / 2⁷
    EXPECT_NEAR(norm(compute(*dog_leg).step) / length, 1.0, 1e-7);
    dog_leg->accepted(0.1);
  }
  EXPECT_LT(norm(compute(*dog_leg).step), 0.9 * length);
}

TEST_P(DogLeg, ARejectedStepIsNotTriedAgainHoweverLargeTheRadius) {
  const double length = norm(gauss_newton_step());
  const auto dog_leg = strategy(1e6 * length);
  compute(*dog_leg);
  dog_leg->rejected();
  const double next = norm(compute(*dog_leg).step);
  EXPECT_LT(next, length);
  EXPECT_GE(next, 0.5 * length * (1.0 - 1e-12));
}

TEST_P(DogLeg, OnlyANewStateCostsALinearSolve) {
  const auto dog_leg = strategy(std::nullopt);
  compute(*dog_leg);
  for (int k = 0; k < 3; ++k) {
    dog_leg->rejected();
    compute(*dog_leg);
  }
  EXPECT_EQ(solver.dampings.size(), 1u);
  dog_leg->accepted(0.5);
  compute(*dog_leg);
  EXPECT_EQ(solver.dampings.size(), 2u);
  dog_leg->rejected();
  dog_leg->moved();
  compute(*dog_leg);
  EXPECT_EQ(solver.dampings.size(), 3u);
}

TEST_P(DogLeg, ASingularSystemGetsMoreRegularizationAndLessOfItLater) {
  const auto dog_leg = strategy(std::nullopt);
  solver.failures_to_come = 3;
  EXPECT_TRUE(compute(*dog_leg).result.valid);
  for (int k = 0; k < 4; ++k) {
    dog_leg->accepted(0.5);
    compute(*dog_leg);
  }
  const std::vector<double> expected{1e-6, 1e-5, 1e-4, 1e-3, 1e-4, 1e-5, 1e-6, 1e-6};
  ASSERT_EQ(solver.dampings.size(), expected.size());
  for (std::size_t k = 0; k < expected.size(); ++k) {
    EXPECT_NEAR(solver.dampings[k] / expected[k], 1.0, 1e-12);
  }
}

TEST_P(DogLeg, InitialDampingIsTheRegularizationHoweverLarge) {
  MinimizerOptions options;
  options.initial_damping = 100.0;
  EXPECT_TRUE(compute(*make_dog_leg(options)).result.valid);
  EXPECT_EQ(solver.dampings, std::vector<double>{100.0});
}

TEST_P(DogLeg, ASystemThatNoRegularizationMakesSolvableIsAFailure) {
  const auto dog_leg = strategy(std::nullopt);
  solver.failures_to_come = 1000;
  EXPECT_FALSE(compute(*dog_leg).result.valid);
  dog_leg->rejected();
  EXPECT_FALSE(dog_leg->can_retry());
  EXPECT_LT(solver.dampings.size(), 20u);
}

INSTANTIATE_TEST_SUITE_P(Metrics,
                         DogLeg,
                         testing::Values(DampingMatrix::kIdentity, DampingMatrix::kDiagonal),
                         [](const auto& test) { return std::string(enum_name(test.param)); });

}  // namespace
}  // namespace sfmcpp::optim::dog_leg_test

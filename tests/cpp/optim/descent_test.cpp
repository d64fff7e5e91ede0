// Gradient descent and conjugate gradients on a linear least-squares problem, where the theory of
// both is exact.
#include <cmath>

#include <Eigen/Cholesky>
#include <Eigen/QR>
#include <gtest/gtest.h>

#include "sfmcpp/linear/step_algebra.hpp"
#include "sfmcpp/optim/step_strategy.hpp"
#include "support/random_system.hpp"

namespace sfmcpp::optim::descent_test {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using linear::DampingMatrix;
using support::RandomSystem;

constexpr int kCameras = 4, kPoints = 10, kCameraSize = 6;
constexpr int kUnknowns = kCameras * kCameraSize + 3 * kPoints;

class UnusedSolver final : public linear::LinearSolver {
 public:
  linear::LinearSolveResult solve(const linear::Damping&,
                                  linear::Step&,
                                  const std::function<bool()>&) override {
    ADD_FAILURE() << "gradient methods solve no system";
    return {};
  }
};

class DescentMethod : public testing::Test {
 protected:
  static MinimizerOptions with(DampingMatrix matrix) {
    MinimizerOptions options;
    options.damping_matrix = matrix;
    return options;
  }
  StepResult compute(StepStrategy& strategy) {
    return strategy.compute(
        problem.normal(), solver, [] { return false; }, step);
  }
  VectorXd flat() const { return flatten(problem.dense(), step); }
  VectorXd gradient() const {
    return -problem.dense().jacobian.transpose() * problem.dense().residual;
  }
  MatrixXd matrix() const {
    return problem.dense().jacobian.transpose() * problem.dense().jacobian;
  }
  double decrease(const VectorXd& delta) const {
    return problem.cost() -
           0.5 * (problem.dense().residual - problem.dense().jacobian * delta).squaredNorm();
  }
  // blockdiag(JᵀJ) with the little damping of the preconditioner.
  MatrixXd preconditioner() const {
    const MatrixXd a = matrix();
    MatrixXd blocks = MatrixXd::Zero(a.rows(), a.cols());
    const int cameras = kCameras * kCameraSize;
    for (int k = 0, size = 0; k < a.cols(); k += size) {
      size = k < cameras ? kCameraSize : 3;
      blocks.block(k, k, size, size) = a.block(k, k, size, size);
    }
    blocks.diagonal() *= 1.0 + 1e-6;
    return blocks;
  }
  VectorXd preconditioned_descent() const { return preconditioner().ldlt().solve(-gradient()); }
  static double sine(const VectorXd& a, const VectorXd& b) {
    const VectorXd across = a - a.dot(b) / b.squaredNorm() * b;
    return across.norm() / a.norm();
  }

  RandomSystem problem{{.cameras = kCameras, .points = kPoints, .camera_size = kCameraSize}};
  UnusedSolver solver;
  linear::Step step;
};

TEST_F(DescentMethod, GradientDescentMinimisesTheModelAlongTheScaledGradient) {
  for (DampingMatrix metric : {DampingMatrix::kIdentity, DampingMatrix::kDiagonal}) {
    const auto descent = make_gradient_descent(with(metric));
    const StepResult result = compute(*descent);
    VectorXd downhill = -gradient();
    if (metric == DampingMatrix::kDiagonal) {
      downhill = downhill.cwiseQuotient(matrix().diagonal()).eval();
    }
    EXPECT_LT(sine(flat(), downhill), 1e-12);
    EXPECT_GT(flat().dot(downhill), 0.0);
    const VectorXd gradient_there = gradient() + matrix() * flat();
    EXPECT_LT(std::abs(gradient_there.dot(flat())), 1e-12 * std::abs(gradient().dot(flat())));
    EXPECT_NEAR(result.predicted_decrease / decrease(flat()), 1.0, 1e-12);
  }
}

TEST_F(DescentMethod, RejectionsHalveTheStepAndSuccessesDoubleItUpToTheMinimumOfTheModel) {
  const auto descent = make_gradient_descent(with(DampingMatrix::kDiagonal));
  compute(*descent);
  const VectorXd whole = flat();
  const auto expect_share = [&](double share) {
    const StepResult result = compute(*descent);
    EXPECT_LT((flat() - share * whole).norm(), 1e-12 * whole.norm()) << share;
    EXPECT_NEAR(result.predicted_decrease / decrease(share * whole), 1.0, 1e-12);
  };
  descent->rejected();
  expect_share(0.5);
  descent->rejected();
  expect_share(0.25);
  for (double share : {0.5, 1.0, 1.0}) {
    descent->accepted(1.0);
    expect_share(share);
  }
}

// After k steps preconditioned conjugate gradients are where the cost is least in the span of
// M⁻¹b, (M⁻¹A) M⁻¹b, …, (M⁻¹A)^(k−1) M⁻¹b: here by QR, without any recurrence.
TEST_F(DescentMethod, ConjugateGradientsMinimiseOverTheKrylovSpaceOfTheBlockJacobiPreconditioner) {
  const auto conjugate = make_conjugate_gradient({});
  const MatrixXd j = problem.dense().jacobian, a = matrix();
  const VectorXd r = problem.dense().residual;
  const Eigen::LDLT<MatrixXd> m(preconditioner());
  MatrixXd basis(a.cols(), 0);
  for (int k = 1; k <= 12; ++k) {
    VectorXd next =
        k == 1 ? VectorXd(m.solve(j.transpose() * r)) : VectorXd(m.solve(a * basis.rightCols(1)));
    for (int pass = 0; pass < 2; ++pass) next -= basis * (basis.transpose() * next);
    basis.conservativeResize(Eigen::NoChange, k);
    basis.col(k - 1) = next.normalized();
    const MatrixXd j_basis = j * basis;
    const VectorXd least = r - j_basis * j_basis.householderQr().solve(r);

    compute(*conjugate);
    problem.move(step);
    conjugate->accepted(1.0);
    EXPECT_NEAR(problem.cost() / (0.5 * least.squaredNorm()), 1.0, 1e-9) << "step " << k;
  }
}

TEST_F(DescentMethod, ConjugateGradientsSolveALinearProblemInAsManyStepsAsItHasUnknowns) {
  const auto conjugate = make_conjugate_gradient({});
  const MatrixXd j = problem.dense().jacobian;
  const VectorXd r = problem.dense().residual;
  const double least = 0.5 * (r - j * j.householderQr().solve(r)).squaredNorm();
  const double start = gradient().norm();
  for (int k = 0; k < kUnknowns; ++k) {
    ASSERT_TRUE(compute(*conjugate).valid);
    problem.move(step);
    conjugate->accepted(1.0);
  }
  EXPECT_LT(gradient().norm(), 1e-9 * start);
  EXPECT_NEAR(problem.cost() / least, 1.0, 1e-12);
}

TEST_F(DescentMethod, ARejectionMakesConjugateGradientsStartAgainFromThePreconditionedGradient) {
  const auto conjugate = make_conjugate_gradient({});
  for (int k = 0; k < 2; ++k) {
    compute(*conjugate);
    problem.move(step);
    conjugate->accepted(1.0);
  }
  compute(*conjugate);
  EXPECT_GT(sine(flat(), preconditioned_descent()), 0.1);
  conjugate->rejected();
  compute(*conjugate);
  EXPECT_LT(sine(flat(), preconditioned_descent()), 1e-10);
  EXPECT_GT(flat().dot(preconditioned_descent()), 0.0);
}

// Off the minimum along the line the formulas of conjugate gradients differ.
TEST_F(DescentMethod, ConjugateGradientsFollowPolakAndRibiere) {
  for (double share : {0.9, 1.1}) {
    const auto conjugate = make_conjugate_gradient({});
    compute(*conjugate);
    const VectorXd last_z = preconditioned_descent(), last_gradient = gradient();
    scale(problem.normal(), share, step);
    problem.move(step);
    conjugate->accepted(1.0);
    const VectorXd z = preconditioned_descent();
    const double beta = z.dot(gradient() - last_gradient) / last_z.dot(last_gradient);
    ASSERT_GT(beta, 0.0);
    compute(*conjugate);
    EXPECT_LT(sine(flat(), z + beta * last_z), 1e-10);
  }
}

// A step ten times too long turns the slope along the last direction around, and β d would lead
// uphill.
TEST_F(DescentMethod, ConjugateGradientsStartAgainWhereTheirDirectionDoesNotDescend) {
  const auto conjugate = make_conjugate_gradient({});
  compute(*conjugate);
  const VectorXd last = flat(), last_gradient = gradient();
  for (int k = 0; k < 10; ++k) problem.move(step);
  conjugate->accepted(1.0);
  const VectorXd z = preconditioned_descent();
  ASSERT_GT(z.dot(last_gradient - gradient()), 0.0) << "no beta to be afraid of";
  ASSERT_GT(gradient().dot(last), 0.0);
  compute(*conjugate);
  EXPECT_LT(sine(flat(), z), 1e-10);
}

}  // namespace
}  // namespace sfmcpp::optim::descent_test

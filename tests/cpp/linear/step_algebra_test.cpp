#include "sfmcpp/linear/step_algebra.hpp"

#include <gtest/gtest.h>

#include "sfmcpp/linear/vector_algebra.hpp"
#include "support/random_system.hpp"

namespace sfmcpp::linear::step_algebra_test {
namespace {

using Eigen::VectorXd;
using support::RandomSystem;

class StepAlgebra : public testing::TestWithParam<support::SystemOptions> {
 protected:
  VectorXd flat(const Step& step) const { return flatten(dense, step); }

  RandomSystem linearized{GetParam()};
  const support::DenseSystem& dense = linearized.dense();
  const NormalEquations& normal = linearized.normal();
  Step x = support::random_step(linearized.map, 1), y = support::random_step(linearized.map, 2);
};

TEST_P(StepAlgebra, IsThatOfTheDenseVectors) {
  const VectorXd dx = flat(x), dy = flat(y);
  EXPECT_NEAR(dot(normal, x, y), dx.dot(dy), 1e-12 * dx.norm() * dy.norm());
  add_scaled(normal, -2.5, x, y);
  EXPECT_LT((flat(y) - (dy - 2.5 * dx)).norm(), 1e-12 * dy.norm());
  scale(normal, 0.25, x);
  EXPECT_EQ(flat(x), 0.25 * dx);
}

TEST_P(StepAlgebra, GradientAndMetricAreThoseOfTheDenseJacobian) {
  const VectorXd gradient = dense.jacobian.transpose() * dense.residual;
  EXPECT_LT((flat(negative_gradient(normal)) - gradient).norm(), 1e-12 * gradient.norm());
  for (DampingMatrix matrix : {DampingMatrix::kDiagonal, DampingMatrix::kIdentity}) {
    const Step metric = damping_entries(normal, matrix);
    const VectorXd d = damping_diagonal(dense, {1.0, matrix});
    EXPECT_LT((flat(metric) - d).norm(), 1e-12 * d.norm());
    const VectorXd dx = flat(x), dy = flat(y);
    const double length = dx.cwiseProduct(d).dot(dx);
    EXPECT_NEAR(norm(normal, x, metric) / std::sqrt(length), 1.0, 1e-12);
    EXPECT_NEAR(dot(normal, x, metric, y), dx.cwiseProduct(d).dot(dy), 1e-12 * length);
    EXPECT_LT((flat(divide(normal, x, metric)) - dx.cwiseQuotient(d)).norm(), 1e-12 * dx.norm());
  }
}

INSTANTIATE_TEST_SUITE_P(Scenes,
                         StepAlgebra,
                         testing::ValuesIn(support::random_systems()),
                         [](const auto& test) { return test.param.name; });

// Vectors of several parts against Eigen, and the same bits on every number of threads.
TEST(VectorAlgebra, IsThatOfEigenInPartsOnAnyNumberOfThreads) {
  const VectorXd x = VectorXd::Random(3 * kNumbersPerTask + 17), y = VectorXd::Random(x.size());
  const Vector vx(x.begin(), x.end()), vy(y.begin(), y.end());
  ThreadPool alone(1);
  const double expected = dot(alone, vx, vy).value();
  EXPECT_NEAR(expected, x.dot(y), 1e-11 * x.norm() * y.norm());
  for (int threads : {1, 2, 5}) {
    ThreadPool pool(threads);
    EXPECT_EQ(dot(pool, vx, vy).value(), expected);
    EXPECT_NEAR(squared_norm(pool, vx).value() / x.squaredNorm(), 1.0, 1e-12);
    Vector sum = vy, other = vy, scaled = vx;
    add_scaled(pool, -2.5, vx, sum);
    scale_and_add(pool, 0.5, vx, other);
    scale(pool, 3.0, scaled);
    EXPECT_EQ((Eigen::Map<VectorXd>(sum.data(), x.size())), y - 2.5 * x);
    EXPECT_EQ((Eigen::Map<VectorXd>(other.data(), x.size())), x + 0.5 * y);
    EXPECT_EQ((Eigen::Map<VectorXd>(scaled.data(), x.size())), 3.0 * x);
  }
}

}  // namespace
}  // namespace sfmcpp::linear::step_algebra_test

#include "sfmcpp/math/numeric_diff.hpp"

#include <gtest/gtest.h>

namespace sfmcpp::numeric_diff_test {
namespace {

using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

// Powers of two and small whole numbers: the differences have no rounding.
TEST(NumericJacobian, IsExactForPolynomialsOfDegreeThree) {
  const auto f = [](const VectorXd& x) -> VectorXd {
    return Vector3d(3 * x[0] - 2 * x[1] + 7,
                    x[0] * x[0] * x[0] + 5 * x[1] - 4 * x[0] * x[0],
                    x[1] * x[1] * x[1] + x[0] * x[1] + x[0]);
  };
  MatrixXd expected(3, 2);
  expected << 3, -2, 0, 5, 1, 0;
  const MatrixXd jacobian = numeric_jacobian(f, Eigen::Vector2d(0.25, 0.5));
  EXPECT_LT((jacobian - expected).cwiseAbs().maxCoeff(), 1e-14);
}

// Of x⁵ the two steps h and h/2 leave (4 (h/2)⁴ − h⁴)/3 = −h⁴/4.
TEST(NumericJacobian, ErrorIsOfFourthOrderInTheStep) {
  const auto f = [](const VectorXd& x) -> VectorXd {
    return VectorXd::Constant(1, std::pow(x[0], 5) + 2 * x[0]);
  };
  for (double step : {0.5, 0.25}) {
    const double error = numeric_jacobian(f, VectorXd::Constant(1, step))(0, 0) - 2.0;
    EXPECT_NEAR(error, -std::pow(step, 4) / 4, 1e-14);
  }
}

}  // namespace
}  // namespace sfmcpp::numeric_diff_test

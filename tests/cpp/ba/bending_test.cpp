// The second derivative of the residuals of a whole problem along a step, against numeric second
// differences of the residuals.
#include "sfmcpp/ba/bending.hpp"

#include <cmath>
#include <ostream>

#include <gtest/gtest.h>

#include "support/linearized_problem.hpp"

namespace sfmcpp::ba::bending_test {
namespace {

struct Case {
  const char* name;
  CameraModelId model;
  int groups = 0;
  bool covariances = false;
  LossKind loss = LossKind::kSquared;
};
void PrintTo(const Case& c, std::ostream* out) { *out << c.name; }

class BendingOfAProblem : public testing::TestWithParam<Case> {
 protected:
  static support::OwnedProblem scene() {
    support::SceneOptions options = support::perturbed(GetParam().model);
    options.num_groups = GetParam().groups;
    options.covariances = GetParam().covariances;
    options.num_points = 300;  // more than a chunk of a camera
    support::OwnedProblem owned = make_circle_scene(options);
    owned.fixed_points[3] = owned.fixed_cameras[1] = 1;
    return owned;
  }
  std::vector<double> residuals(const linear::Step& step, double length) {
    optim::State moved = work.state;
    work.model.plus(work.state, step, {length, length}, moved);
    return work.model.images().values(moved);
  }

  support::LinearizedProblem work{scene()};
};

TEST_P(BendingOfAProblem, IsMinusTheWeightedSecondDifferenceOfTheResiduals) {
  const Loss loss{GetParam().loss, 1.0};
  work.model.set_loss(loss);
  work.model.linearize(work.state);
  linear::Step step;
  ASSERT_TRUE(work.solve({linear::LinearSolverKind::kDense}, {1e-3}, step).success);
  const std::span<const double> bending = work.model.bending(work.state, step);
  constexpr double kLength = 0.05;
  const std::vector<double> here = residuals(step, 0.0), ahead = residuals(step, kLength),
                            behind = residuals(step, -kLength);
  ASSERT_EQ(bending.size(), here.size());
  double error = 0.0, size = 0.0;
  for (std::size_t k = 0; k < here.size(); ++k) {
    const std::size_t first = k / 2 * 2;
    const double squared = here[first] * here[first] + here[first + 1] * here[first + 1];
    const double weight = std::sqrt(loss.derivative(squared));
    const double numeric = -weight * (ahead[k] - 2.0 * here[k] + behind[k]) / (kLength * kLength);
    error += (bending[k] - numeric) * (bending[k] - numeric);
    size += numeric * numeric;
  }
  EXPECT_GT(size, 0.0);
  EXPECT_LT(std::sqrt(error), 1e-3 * std::sqrt(size));
}

INSTANTIATE_TEST_SUITE_P(
    Problems,
    BendingOfAProblem,
    testing::Values(Case{"Calibrated", CameraModelId::kCalibrated},
                    Case{"SharedPerspective", CameraModelId::kPerspective, 2},
                    Case{"BalWithCovariances", CameraModelId::kBal, 0, true},
                    Case{"RobustBal", CameraModelId::kBal, 3, false, LossKind::kCauchy},
                    Case{"Projective", CameraModelId::kProjective}),
    [](const auto& test) { return std::string(test.param.name); });

}  // namespace
}  // namespace sfmcpp::ba::bending_test

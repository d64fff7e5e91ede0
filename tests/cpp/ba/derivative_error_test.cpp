// Derivatives of a function from outside against numeric ones.
#include <cmath>
#include <memory>

#include <gtest/gtest.h>

#include "sfmcpp/ba/check_jacobians.hpp"
#include "support/refusal.hpp"
#include "support/small_scenes.hpp"

namespace sfmcpp::ba::derivative_error_test {
namespace {

using residuals::ConstraintGroup;
using residuals::ResidualFunction;

enum class Mistake { kNone, kSign, kUnwritten, kNotANumber, kPoint };

// Depths of points: the third column of R, times the point less the centre.
class Depths final : public ResidualFunction {
 public:
  Depths(int members, Mistake mistake) : members_(members), mistake_(mistake) {}
  int rows() const override { return 1; }
  void evaluate(const double* poses, const double* points, const Output& out) const override {
    for (int k = 0; k < members_; ++k) {
      const double *pose = poses + 12L * k, *point = points + 3L * k;
      double local[3] = {0, 0, 0};
      for (int row = 0; row < 3; ++row) {
        for (int axis = 0; axis < 3; ++axis)
          local[axis] += pose[4 * row + axis] * (point[row] - pose[4 * row + 3]);
      }
      out.residuals[k] = local[2];
      if (out.by_points != nullptr) {
        for (int row = 0; row < 3; ++row)
          out.by_points[3 * k + row] =
              (mistake_ == Mistake::kPoint ? 1.1 : 1.0) * pose[4 * row + 2];
      }
      if (out.by_poses == nullptr || mistake_ == Mistake::kUnwritten) continue;
      double* by_pose = out.by_poses + 6L * k;
      by_pose[0] = mistake_ == Mistake::kSign ? local[1] : -local[1];
      by_pose[1] = mistake_ == Mistake::kNotANumber ? NAN : local[0];
      by_pose[2] = 0.0;
      for (int row = 0; row < 3; ++row) by_pose[3 + row] = -pose[4 * row + 2];
    }
  }

 private:
  int members_;
  Mistake mistake_;
};

// One residual of two poses: where the second is along the first's axis.
class Ahead final : public ResidualFunction {
 public:
  explicit Ahead(double factor) : factor_(factor) {}
  int rows() const override { return 1; }
  void evaluate(const double* poses, const double*, const Output& out) const override {
    const double *first = poses, *second = poses + 12;
    double local[3] = {0, 0, 0};
    for (int row = 0; row < 3; ++row) {
      for (int axis = 0; axis < 3; ++axis)
        local[axis] += first[4 * row + axis] * (second[4 * row + 3] - first[4 * row + 3]);
    }
    *out.residuals = local[2];
    if (out.by_poses == nullptr) return;
    double *by_first = out.by_poses, *by_second = out.by_poses + 6;
    by_first[0] = -local[1];
    by_first[1] = local[0];
    by_first[2] = 0.0;
    for (int row = 0; row < 3; ++row) {
      by_first[3 + row] = -first[4 * row + 2];
      by_second[row] = 0.0;
      by_second[3 + row] = factor_ * first[4 * row + 2];
    }
  }

 private:
  double factor_;
};

const support::OwnedProblem& scene() {
  static const support::OwnedProblem kScene =
      make_circle_scene(support::perturbed(CameraModelId::kCalibrated));
  return kScene;
}

double error_of(Mistake mistake, double weight = 1.0, double weight_of_members = 1.0) {
  ConstraintGroup group{.name = "depths", .weight = weight};
  for (int k = 0; k < 5; ++k)
    group.members.push_back({.camera = k % 2, .point = k, .weight = weight_of_members});
  group.members[2].weight *= 7.0;
  group.function = std::make_shared<Depths>(5, mistake);
  return derivative_error(scene().view(), group);
}

TEST(DerivativeError, IsRoundingWhereTheDerivativesAreRight) {
  EXPECT_LT(error_of(Mistake::kNone), 1e-9);
  EXPECT_GT(error_of(Mistake::kNone), 0.0);
}

TEST(DerivativeError, TellsAWrongSignAndDerivativesThatAreNotWritten) {
  EXPECT_GT(error_of(Mistake::kSign), 0.1);
  EXPECT_TRUE(std::isnan(error_of(Mistake::kUnwritten)));
  EXPECT_TRUE(std::isnan(error_of(Mistake::kNotANumber)));
}

TEST(DerivativeError, TellsDerivativesByPointsThatAreOff) {
  EXPECT_GT(error_of(Mistake::kPoint), 0.05);
  EXPECT_LT(error_of(Mistake::kPoint), 0.15);
}

TEST(DerivativeError, IsTheSameWhateverTheWeights) {
  EXPECT_EQ(error_of(Mistake::kPoint, 0.0), error_of(Mistake::kPoint));
  EXPECT_EQ(error_of(Mistake::kSign, 3.0, 0.0), error_of(Mistake::kSign));
}

TEST(DerivativeError, LooksAtBothPosesOfAPair) {
  ConstraintGroup group{.name = "ahead"};
  group.members.push_back({.camera = 3, .previous = 1});
  group.function = std::make_shared<Ahead>(1.0);
  EXPECT_LT(derivative_error(scene().view(), group), 1e-9);
  group.function = std::make_shared<Ahead>(0.5);
  EXPECT_GT(derivative_error(scene().view(), group), 0.01);
}

TEST(DerivativeError, OfABuiltInKindIsZeroAndACameraOutOfRangeIsRefused) {
  ConstraintGroup group{.name = "gps"};
  group.members.push_back({.camera = 1});
  EXPECT_EQ(derivative_error(scene().view(), group), 0.0);
  group.members[0].camera = 99;
  support::expect_refused([&] { derivative_error(scene().view(), group); }, {"gps", "99"});
}

}  // namespace
}  // namespace sfmcpp::ba::derivative_error_test

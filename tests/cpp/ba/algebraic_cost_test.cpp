// The nine sums of a problem against the algebraic error itself, and the lengths they propose.
#include "sfmcpp/ba/algebraic_cost.hpp"

#include <cmath>

#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include "sfmcpp/linear/step_algebra.hpp"
#include "sfmcpp/math/numeric_diff.hpp"
#include "support/algebraic_reference.hpp"
#include "support/all_models.hpp"
#include "support/dense_reference.hpp"

namespace sfmcpp::ba::algebraic_cost_test {
namespace {

using Eigen::Vector2d;
using Eigen::VectorXd;
using linear::Step;
using support::AlgebraicReference;
using support::LinearizedProblem;

constexpr unsigned kSeeds = 5;

class AlgebraicCostOf : public testing::TestWithParam<CameraModelId> {
 protected:
  // Every intrinsic parameter free that can be.
  static support::OwnedProblem scene(unsigned seed) {
    support::SceneOptions options = support::perturbed(GetParam());
    options.num_points = 60;
    options.num_groups = 3;
    options.varied_sigma = true;
    options.seed = seed;
    if (GetParam() == CameraModelId::kPerspective)
      options.free_intrinsics = std::vector<int>{0, 1, 2, 3, 4, 5, 6, 10, 11};
    support::OwnedProblem result = make_circle_scene(options);
    result.fixed_cameras[1] = result.fixed_points[3] = 1;
    return result;
  }

  // Of a start as far from the minimum as line searches are made for.
  static Step damped_step(const LinearizedProblem& work) {
    Step step;
    const linear::Damping damping{1e-3, linear::DampingMatrix::kDiagonal};
    EXPECT_TRUE(work.solve({linear::LinearSolverKind::kDense}, damping, step).success);
    return step;
  }
  static Step random_step(const LinearizedProblem& work, unsigned seed) {
    Step step = support::random_step(work.map, seed);
    linear::scale(work.normal(), 0.01, step);
    return step;
  }
  static Biquadratic sums(LinearizedProblem& work, const Step& step, AlgebraicWeights weights) {
    work.model.set_algebraic_weights(weights);
    return work.model.algebraic_cost(work.state, step).value();
  }
};

constexpr std::pair<double, double> kPlaces[] = {
    {0.0, 0.0}, {1.0, 1.0}, {0.7, -0.4}, {-1.3, 2.1}, {5.0, 0.0}};
constexpr AlgebraicWeights kBothWeights[] = {AlgebraicWeights::kUniform,
                                             AlgebraicWeights::kInverseDepth};

TEST_P(AlgebraicCostOf, IsTheErrorAtTheMovedMatricesAndPoints) {
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    LinearizedProblem work(scene(seed));
    for (const Step& step : {damped_step(work), random_step(work, seed)}) {
      for (AlgebraicWeights weights : kBothWeights) {
        const AlgebraicReference reference(work, step, weights);
        const Biquadratic cost = sums(work, step, weights);
        for (const auto& [x, y] : kPlaces) {
          EXPECT_NEAR(cost.value(x, y) / reference.cost(x, y), 1.0, 1e-10)
              << enum_name(weights) << " at " << x << ", " << y << ", seed " << seed;
        }
      }
    }
  }
}

TEST_P(AlgebraicCostOf, HasTheRobustWeightsOfTheCostWhereItWasLinearised) {
  LinearizedProblem work(scene(1));
  const Step step = damped_step(work);
  for (LossKind kind : {LossKind::kHuber, LossKind::kCauchy, LossKind::kTukey}) {
    const Loss loss{kind, 12.0};
    work.model.set_loss(loss);
    work.model.linearize(work.state);
    for (AlgebraicWeights weights : kBothWeights) {
      const AlgebraicReference reference(work, step, weights, loss);
      const AlgebraicReference unweighted(work, step, weights);
      ASSERT_LT(reference.cost(0.5, 0.8), 0.9 * unweighted.cost(0.5, 0.8)) << "nothing is far off";
      EXPECT_NEAR(sums(work, step, weights).value(0.5, 0.8) / reference.cost(0.5, 0.8), 1.0, 1e-10)
          << enum_name(kind) << ", " << enum_name(weights);
    }
  }
}

// With distortion: that between the pixels without it and the image of the pinhole.
TEST_P(AlgebraicCostOf, WeighedByInverseDepthStartsAsTheGeometricCost) {
  LinearizedProblem work(scene(2));
  const double start =
      sums(work, damped_step(work), AlgebraicWeights::kInverseDepth).value(0.0, 0.0);
  const bool distorts = has_free_intrinsics(GetParam());
  if (!distorts) {
    EXPECT_NEAR(start / work.model.cost(work.state), 1.0, 1e-12);
    return;
  }
  double geometric = 0.0;
  for (int k = 0; k < work.problem.num_observations(); ++k) {
    const Eigen::Vector3d x(&work.state.points[3UL * work.problem.point_index[k]]);
    const Vector2d image = (pinhole_matrix(work, k) * x.homogeneous()).hnormalized();
    const Vector2d error = (undistorted_pixel(work, k) - image) / work.problem.sigma_px[k];
    geometric += 0.5 * error.squaredNorm();
  }
  EXPECT_NEAR(start / geometric, 1.0, 1e-10);
  EXPECT_NEAR(start / work.model.cost(work.state), 1.0, 0.3) << "the lens is not that strong";
}

TEST_P(AlgebraicCostOf, HasTheSameBitsForEveryNumberOfThreads) {
  support::SceneOptions options = support::perturbed(GetParam());
  options.num_points = 1500;  // several chunks to a camera
  const support::OwnedProblem large = make_circle_scene(options);
  LinearizedProblem one(large);
  const Step step = random_step(one, 3);
  const auto [aa, ap, aq, pp, qq, pq, pc, qc, cc] = sums(one, step, AlgebraicWeights::kUniform);
  for (int threads : {2, 3}) {
    LinearizedProblem more(large, false, threads);
    const Biquadratic again = sums(more, step, AlgebraicWeights::kUniform);
    EXPECT_EQ(again.aa, aa);
    EXPECT_EQ(again.ap, ap);
    EXPECT_EQ(again.aq, aq);
    EXPECT_EQ(again.pp, pp);
    EXPECT_EQ(again.qq, qq);
    EXPECT_EQ(again.pq, pq);
    EXPECT_EQ(again.pc, pc);
    EXPECT_EQ(again.qc, qc);
    EXPECT_EQ(again.cc, cc);
  }
}

// |dF| over ‖r‖ ‖dr‖ for F = ½‖r‖², both derivatives along `direction`, by differences that are
// exact for the polynomials that F and r are.
double relative_slope(const AlgebraicReference& reference, Vector2d at, Vector2d direction) {
  const double size = std::max(0.1, at.cwiseProduct(direction).norm());
  const VectorXd step = VectorXd::Constant(1, 0.5 * size);
  const auto point = [&](const VectorXd& t) -> Vector2d { return at + t[0] * direction; };
  const auto cost = [&](const VectorXd& t) -> VectorXd {
    return VectorXd::Constant(1, reference.cost(point(t)[0], point(t)[1]));
  };
  const auto residuals = [&](const VectorXd& t) -> VectorXd {
    return reference.residuals(point(t)[0], point(t)[1]);
  };
  const double slope = numeric_jacobian(cost, step)(0, 0);
  const VectorXd change = numeric_jacobian(residuals, step);
  return std::abs(slope) / (reference.residuals(at[0], at[1]).norm() * change.norm());
}

TEST_P(AlgebraicCostOf, ProposedCommonLengthsAreStationary) {
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    LinearizedProblem work(scene(seed));
    for (const Step& step : {damped_step(work), random_step(work, seed)}) {
      for (AlgebraicWeights weights : kBothWeights) {
        const AlgebraicReference reference(work, step, weights);
        const std::vector<double> lengths = sums(work, step, weights).stationary_lengths();
        EXPECT_TRUE(lengths.size() == 1 || lengths.size() == 3) << lengths.size();
        for (double length : lengths) {
          EXPECT_LT(relative_slope(reference, {length, length}, {1, 1}), 1e-8)
              << length << ", " << enum_name(weights) << ", seed " << seed;
        }
      }
    }
  }
}

TEST_P(AlgebraicCostOf, ProposedPairsOfLengthsAreStationaryInBoth) {
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    LinearizedProblem work(scene(seed));
    for (const Step& step : {damped_step(work), random_step(work, seed)}) {
      for (AlgebraicWeights weights : kBothWeights) {
        const AlgebraicReference reference(work, step, weights);
        const auto pairs = sums(work, step, weights).stationary_pairs();
        EXPECT_FALSE(pairs.empty());
        for (const auto& [x, y] : pairs) {
          EXPECT_LT(relative_slope(reference, {x, y}, {1, 0}), 1e-8) << x << ", " << y;
          EXPECT_LT(relative_slope(reference, {x, y}, {0, 1}), 1e-8) << x << ", " << y;
        }
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Models,
                         AlgebraicCostOf,
                         testing::ValuesIn(support::all_models()),
                         support::name_of_model);

}  // namespace
}  // namespace sfmcpp::ba::algebraic_cost_test

// Observations with a covariance: everything that a solve is made of, whitened.
#include <array>
#include <cmath>
#include <string>

#include <Eigen/LU>
#include <gtest/gtest.h>

#include "sfmcpp/ba/solve.hpp"
#include "sfmcpp/linear/step_algebra.hpp"
#include "sfmcpp/math/numeric_diff.hpp"
#include "support/algebraic_reference.hpp"
#include "support/all_models.hpp"
#include "support/dense_reference.hpp"
#include "support/whitening_factor.hpp"

namespace sfmcpp::ba::covariance_test {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using linear::LinearSolverKind;
using linear::Step;
using optim::LineSearchKind;
using optim::Method;
using optim::State;
using support::LinearizedProblem;
using support::OwnedProblem;

constexpr LossKind kLosses[] = {
    LossKind::kSquared, LossKind::kHuber, LossKind::kCauchy, LossKind::kTukey};

OwnedProblem scene(CameraModelId model) {
  support::SceneOptions options = support::perturbed(model);
  options.num_groups = 2;
  options.covariances = true;
  return make_circle_scene(options);
}

class CovariancesOf : public testing::TestWithParam<CameraModelId> {
 protected:
  static OwnedProblem scene_with_fixed_parts() {
    OwnedProblem result = scene(GetParam());
    result.fixed_cameras[2] = result.fixed_points[5] = 1;
    return result;
  }
  void set_loss(const Loss& loss) {
    work.model.set_loss(loss);
    work.model.linearize(work.state);
  }
  Step damped_step() const {
    Step step;
    const linear::Damping damping{1e-2, linear::DampingMatrix::kDiagonal};
    EXPECT_TRUE(work.solve({LinearSolverKind::kDense}, damping, step).success);
    return step;
  }
  State moved(const Step& step, double length) const {
    State result = work.state;
    work.model.plus(work.state, step, {length, length}, result);
    return result;
  }

  LinearizedProblem work{scene_with_fixed_parts()};
};

TEST_P(CovariancesOf, TheCostIsThatOfTheMahalanobisDistances) {
  const Problem& problem = work.problem;
  OwnedProblem plain = work.owned;
  plain.covariance_px2.clear();
  LinearizedProblem in_pixels(plain);
  const std::vector<double> distances = in_pixels.model.images().values(work.state);
  double sum = 0.0;
  for (int k = 0; k < problem.num_observations(); ++k) {
    const auto source = static_cast<long>(in_pixels.graph.source[k]);
    const Eigen::Map<const Eigen::Matrix2d> sigma(problem.covariance_px2.data() + 4 * source);
    const Eigen::Vector2d d(distances[2 * k], distances[2 * k + 1]);
    sum += d.dot(sigma.inverse() * d);
  }
  EXPECT_NEAR(work.model.cost(work.state) / (0.5 * sum), 1.0, 1e-12);
}

TEST_P(CovariancesOf, TheJacobianIsTheNumericDerivativeOfTheResiduals) {
  const Step step = support::random_step(work.map, 3);
  const auto residuals = [&](const VectorXd& length) -> VectorXd {
    const std::vector<double> r = work.model.images().values(moved(step, length[0]));
    return VectorXd::Map(r.data(), static_cast<Eigen::Index>(r.size()));
  };
  const VectorXd numeric = numeric_jacobian(residuals, VectorXd::Constant(1, 1e-5));
  const int size = work.map.camera_size;
  VectorXd analytic(numeric.size());
  for (int k = 0; k < work.graph.num_observations(); ++k) {
    std::array<double, linear::kMaxCameraSize> by_camera{};
    work.map.expand(step.camera.data(), work.graph.camera[k], by_camera.data());
    const double* by_point = step.point.data() + 3L * work.graph.point[k];
    for (int row = 0; row < 2; ++row) {
      const auto& record = work.normal().point_record(k).row[row];
      double change = 0.0;
      for (int c = 0; c < size; ++c)
        change += work.normal().camera_jacobian(k)[row * size + c] * by_camera[c];
      for (int c = 0; c < 3; ++c) change += record.by_point[c] * by_point[c];
      analytic[2 * k + row] = -change;
    }
  }
  EXPECT_LT((analytic - numeric).norm(), 1e-6 * numeric.norm());
}

TEST_P(CovariancesOf, NormalEquationsAreThoseOfTheDenseWhitenedJacobianForEveryLoss) {
  for (LossKind kind : kLosses) {
    const Loss loss{kind, 5.0};
    set_loss(loss);
    const support::DenseSystem dense = make_dense_system(work, loss);
    const VectorXd expected = dense.jacobian.transpose() * dense.residual;
    const MatrixXd hessian = dense.jacobian.transpose() * dense.jacobian;
    ASSERT_EQ(static_cast<int>(work.normal().camera_rhs().size()), dense.camera_columns);
    for (int k = 0; k < dense.camera_columns; ++k)
      EXPECT_NEAR(work.normal().camera_rhs()[k], expected[k], 1e-12 * expected.norm());
    const Step step = damped_step();
    VectorXd all(dense.jacobian.cols());
    for (int k = 0; k < dense.camera_columns; ++k) all[k] = step.camera[k];
    for (std::size_t p = 0; p < dense.point_column.size(); ++p) {
      for (int c = 0; c < 3 && dense.point_column[p] >= 0; ++c)
        all[dense.point_column[p] + c] = step.point[3 * p + c];
    }
    const VectorXd damped = hessian * all + 1e-2 * hessian.diagonal().cwiseProduct(all);
    EXPECT_LT((damped - expected).norm(), 1e-8 * expected.norm()) << enum_name(kind);
  }
}

TEST_P(CovariancesOf, TheSlopeIsTheDerivativeOfTheCostForEveryLoss) {
  for (LossKind kind : kLosses) {
    set_loss({kind, 40.0});
    const Step step = damped_step();
    for (double length : {0.0, 0.6, 1.5}) {
      const auto cost = [&](const VectorXd& further) -> VectorXd {
        return VectorXd::Constant(1, work.model.cost(moved(step, length + further[0])));
      };
      const double numeric = numeric_jacobian(cost, VectorXd::Constant(1, 1e-4))(0, 0);
      const double slope = work.model.slope(work.state, step, moved(step, length));
      EXPECT_NEAR(slope / numeric, 1.0, 1e-6) << enum_name(kind) << " at " << length;
    }
  }
}

TEST_P(CovariancesOf, TheNineSumsAreThoseOfWhitenedAlgebraicErrors) {
  for (LossKind kind : kLosses) {
    const Loss loss{kind, 12.0};
    set_loss(loss);
    const Step step = damped_step();
    for (AlgebraicWeights weights : {AlgebraicWeights::kUniform, AlgebraicWeights::kInverseDepth}) {
      const support::AlgebraicReference reference(work, step, weights, loss);
      work.model.set_algebraic_weights(weights);
      const Biquadratic sums = work.model.algebraic_cost(work.state, step).value();
      for (const auto& [x, y] : {std::pair{0.0, 0.0}, {1.0, 1.0}, {0.7, -0.4}, {-1.3, 2.1}})
        EXPECT_NEAR(sums.value(x, y) / reference.cost(x, y), 1.0, 1e-10) << enum_name(weights);
    }
  }
}

// Where the lens does not distort, and weighted by depth, the algebraic cost is the cost.
TEST(Covariances, TheAlgebraicCostStartsAsTheGeometricOne) {
  for (CameraModelId model : {CameraModelId::kCalibrated, CameraModelId::kProjective}) {
    LinearizedProblem work(scene(model));
    work.model.set_algebraic_weights(AlgebraicWeights::kInverseDepth);
    const Step step = support::random_step(work.map, 3);
    const Biquadratic sums = work.model.algebraic_cost(work.state, step).value();
    EXPECT_NEAR(sums.value(0.0, 0.0) / work.model.cost(work.state), 1.0, 1e-10);
  }
}

SolveOptions precise(Method method) {
  SolveOptions options;
  options.minimizer.method = method;
  options.minimizer.termination.function_tolerance = 1e-14;
  options.minimizer.termination.max_iterations = 200;
  return options;
}

SolveSummary solved(const OwnedProblem& problem, const SolveOptions& options, State& state) {
  state = state_of(problem.view());
  return solve(problem.view(), options, {}, state);
}

double final_cost(const OwnedProblem& problem, const SolveOptions& options) {
  State state;
  return solved(problem, options, state).minimizer.final_cost;
}

bool is_second_order(Method method) { return facts_of(method).solves_linear_system; }

TEST_P(CovariancesOf, EveryMethodAndLinearSolverReachesTheSameMinimum) {
  const OwnedProblem problem = scene(GetParam());
  const double minimum = final_cost(problem, precise(Method::kLevenbergMarquardt));
  for (const auto& [method, method_name] : EnumNames<Method>::kTable) {
    if (facts_of(method).needs_fixed_gauge() && !is_metric(GetParam())) continue;
    if (!is_second_order(method)) continue;
    for (const auto& [solver, solver_name] : EnumNames<LinearSolverKind>::kTable) {
      SolveOptions options = precise(method);
      options.linear_solver.kind = solver;
      if (solver == LinearSolverKind::kAuto || solver == LinearSolverKind::kIterative) {
        options.linear_solver.pcg_tolerance = 1e-8;
        options.linear_solver.pcg_max_iterations = 5000;
      }
      EXPECT_NEAR(final_cost(problem, options) / minimum, 1.0, 1e-8)
          << method_name << " " << solver_name;
    }
  }
}

TEST_P(CovariancesOf, EveryMethodGoesDownWithEveryLineSearchAndTheFastOnesToTheMinimum) {
  const OwnedProblem problem = scene(GetParam());
  const double minimum = final_cost(problem, precise(Method::kLevenbergMarquardt));
  for (const auto& [method, method_name] : EnumNames<Method>::kTable) {
    if (facts_of(method).needs_fixed_gauge() && !is_metric(GetParam())) continue;
    for (const auto& [search, search_name] : EnumNames<LineSearchKind>::kTable) {
      SCOPED_TRACE(std::string(method_name) + " " + std::string(search_name));
      SolveOptions options = precise(method);
      options.minimizer.line_search.kind = search;
      if (search != LineSearchKind::kNone) options.minimizer.line_search.iterations = 1000;
      if (!is_second_order(method)) options.minimizer.termination.max_iterations = 30;
      State state;
      const SolveSummary summary = solved(problem, options, state);
      const double first = summary.minimizer.initial_cost, last = summary.minimizer.final_cost;
      EXPECT_LT(last, 0.5 * first);
      if (is_second_order(method)) {
        EXPECT_NEAR(last / minimum, 1.0, 1e-8);
      }
    }
  }
}

// The bounds of ground_truth_test.cpp; a residual that is not white has another floor.
TEST(Covariances, NoisyDataEndAtTheNoiseFloorFromBothSides) {
  support::SceneOptions noisy = support::perturbed(CameraModelId::kCalibrated);
  noisy.noise_px = 0.7;
  noisy.covariances = true;
  State state;
  const SolveSummary summary =
      solved(make_circle_scene(noisy), precise(Method::kLevenbergMarquardt), state);
  const double residuals = 2.0 * 6 * 40, unknowns = 6 * 6 + 3 * 40 - 7;
  const double floor = 0.7 * std::sqrt(1.0 - unknowns / residuals);
  const double spread = 1.0 / std::sqrt(2.0 * (residuals - unknowns));
  EXPECT_GT(summary.final_rms_px, floor * (1.0 - 4 * spread));
  EXPECT_LT(summary.final_rms_px, floor * (1.0 + 4 * spread));
}

// Also beside observations that are not round: whitening must not touch those that are.
TEST_P(CovariancesOf, RoundOnesHaveTheBitsOfStandardDeviations) {
  support::SceneOptions options = support::perturbed(GetParam());
  options.varied_sigma = true;
  OwnedProblem by_sigma = make_circle_scene(options);
  for (double& sigma : by_sigma.sigma_px) sigma *= 1.1;
  OwnedProblem by_covariance = by_sigma;
  by_covariance.sigma_px.clear();
  for (double sigma : by_sigma.sigma_px) {
    const double variance = sigma * sigma;
    for (double x : {variance, 0.0, 0.0, variance}) by_covariance.covariance_px2.push_back(x);
  }
  for (LossKind loss : kLosses) {
    for (LineSearchKind search : {LineSearchKind::kNone, LineSearchKind::kTwoWayAlgebraic}) {
      SolveOptions how;
      how.loss = loss;
      how.minimizer.line_search.kind = search;
      how.minimizer.termination.max_iterations = 6;
      State a, b;
      const double cost_a = solved(by_sigma, how, a).minimizer.final_cost;
      const double cost_b = solved(by_covariance, how, b).minimizer.final_cost;
      EXPECT_EQ(cost_a, cost_b);
      EXPECT_EQ(a.cameras, b.cameras);
      EXPECT_EQ(a.points, b.points);
    }
  }
  LinearizedProblem round(by_sigma);
  by_covariance.covariance_px2[1] = by_covariance.covariance_px2[2] = 0.1;
  LinearizedProblem mixed(by_covariance);
  const std::vector<double> r = round.model.images().values(round.state);
  const std::vector<double> s = mixed.model.images().values(round.state);
  int different = 0;
  for (std::size_t k = 0; k < r.size(); ++k) different += r[k] != s[k];
  EXPECT_EQ(different, 1) << "the second residual of observation 0";
}

INSTANTIATE_TEST_SUITE_P(Models,
                         CovariancesOf,
                         testing::ValuesIn(support::all_models()),
                         support::name_of_model);

}  // namespace
}  // namespace sfmcpp::ba::covariance_test

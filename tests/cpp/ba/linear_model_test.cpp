// The linear model of a problem against dense algebra on its own Jacobian, for every metric model.
#include "sfmcpp/ba/linear_model.hpp"

#include <limits>
#include <numeric>

#include <Eigen/LU>
#include <gtest/gtest.h>

#include "sfmcpp/ba/solve.hpp"
#include "support/refusal.hpp"
#include "support/small_scenes.hpp"

namespace sfmcpp::ba::linear_model_test {
namespace {

using Eigen::MatrixXd;
using support::OwnedProblem;

class LinearModelOf : public testing::TestWithParam<CameraModelId> {
 protected:
  static OwnedProblem scene() {
    OwnedProblem result = make_circle_scene(support::perturbed(GetParam()));
    result.fixed_points[3] = 1;
    residuals::ConstraintGroup group{"gps", residuals::ConstraintKind::kPosition, 300.0, {}};
    for (int camera : {0, 2, 4}) {
      residuals::ConstraintMember member;
      member.camera = camera;
      member.pose.translation = Eigen::Vector3d(1.0, 2.0, 3.0);
      group.members.push_back(member);
    }
    result.constraints.add(group);
    return result;
  }

  static SolveOptions fixed_gauge() {
    SolveOptions options;
    options.gauge = Gauge::kFixed;
    options.num_threads = 1;
    return options;
  }

  // H from the blocks of J and the rows of G.
  static MatrixXd normal_matrix(const LinearModel& model, const Problem& problem) {
    const int size = model.camera_size(), count = model.num_observations();
    std::vector<double> camera(2UL * size * count), point(6UL * count);
    std::vector<int> camera_columns(static_cast<std::size_t>(size) * model.num_cameras());
    std::vector<int> point_columns(model.num_points());
    model.jacobian(camera.data(), point.data());
    model.camera_columns(camera_columns.data());
    model.point_columns(point_columns.data());
    MatrixXd rows = MatrixXd::Zero(2 * count, model.num_columns());
    for (int row = 0; row < 2 * count; ++row) {
      for (int k = 0; k < size; ++k) {
        const int column = camera_columns[size * problem.camera_index[row / 2] + k];
        if (column >= 0) rows(row, column) += camera[static_cast<std::size_t>(size) * row + k];
      }
      for (int k = 0; k < 3; ++k) {
        const int column = point_columns[problem.point_index[row / 2]];
        if (column >= 0) rows(row, column + k) += point[3UL * row + k];
      }
    }
    MatrixXd normal = rows.transpose() * rows;
    for (const ConstraintRows& group : model.groups()) {
      const MatrixXd own = group.jacobian.transpose() * group.jacobian;
      normal.topLeftCorner(own.rows(), own.cols()) += group.weight * own;
    }
    return normal;
  }
};

TEST_P(LinearModelOf, CovarianceIsTheDenseInverseOfTheNormalMatrix) {
  const OwnedProblem owned = scene();
  Problem problem = owned.view();
  LinearModel model(problem, fixed_gauge());
  const MatrixXd normal = normal_matrix(model, problem);
  const Eigen::VectorXd scale = normal.diagonal().cwiseSqrt().cwiseInverse();
  const MatrixXd inverse = scale.asDiagonal() *
                           (scale.asDiagonal() * normal * scale.asDiagonal()).inverse().eval() *
                           scale.asDiagonal();
  std::vector<int> columns(model.num_columns());
  std::iota(columns.begin(), columns.end(), 0);
  const MatrixXd found = model.covariance(columns);
  for (int a = 0; a < found.rows(); ++a) {
    for (int b = 0; b < found.cols(); ++b)
      EXPECT_NEAR(found(a, b), inverse(a, b), 1e-8 * std::sqrt(inverse(a, a) * inverse(b, b)));
  }
}

TEST_P(LinearModelOf, LeveragesAndHatsAddUpToWhatIsDetermined) {
  const OwnedProblem owned = scene();
  Problem problem = owned.view();
  SolveOptions options;
  options.num_threads = 2;
  LinearModel model(problem, options);
  std::vector<double> leverages(4UL * model.num_observations());
  model.leverages(leverages.data());
  double used = model.hat(0).trace();
  for (std::size_t k = 0; k < leverages.size(); k += 4) used += leverages[k] + leverages[k + 3];
  EXPECT_NEAR(used, model.num_determined(), 1e-5);
}

// Few blocks come from the factor, all of them, points with cameras, from the inverse.
TEST_P(LinearModelOf, BlocksAreThoseOfTheWholeCovarianceForEveryNumberOfThreads) {
  const OwnedProblem owned = scene();
  for (Gauge gauge : {Gauge::kFixed, Gauge::kFree}) {
    for (int blocks : {2, 40}) {
      std::vector<double> reference;
      for (int threads : {1, 2, 3}) {
        SolveOptions options;
        options.gauge = gauge;
        options.num_threads = threads;
        LinearModel model(owned.view(), options);
        const int points = model.num_camera_columns(), width = 3;
        std::vector<int> columns{0, -1, 2};
        for (int k = 1; k < std::min(blocks, (model.num_columns() - points) / 3); ++k)
          for (int row = 0; row < 3; ++row) columns.push_back(points + 3 * k + row);
        std::vector<double> found(columns.size() * width);
        model.covariance_blocks(columns, width, found.data());
        if (threads == 1) reference = found;
        EXPECT_EQ(found, reference) << threads << " threads";
        const Eigen::Map<const MatrixXd> last(&found[found.size() - 9], 3, 3);
        const MatrixXd expected = model.covariance(std::span(columns).last(3));
        EXPECT_LT((last - expected).norm(), 1e-9 * expected.norm());
        EXPECT_EQ(found[4], 0.0);
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Metric,
                         LinearModelOf,
                         testing::Values(CameraModelId::kCalibrated,
                                         CameraModelId::kPerspective,
                                         CameraModelId::kBal));

TEST(LinearModel, GroupsAndBlocksThatItHasNotAreRefused) {
  const OwnedProblem owned = make_circle_scene(support::perturbed(CameraModelId::kCalibrated));
  LinearModel model(owned.view(), SolveOptions{});
  for (int group : {-1, 0, 7}) {
    const std::string told = "group: " + std::to_string(group) + ", must be in [0, 0)";
    support::expect_refused([&] { model.hat(group); }, {told});
    support::expect_refused([&] { model.hat_spectrum(group); }, {told});
  }
  const std::vector<int> columns{0, 1};
  std::vector<double> out(9);
  for (int width : {0, -1, 3}) {
    support::expect_refused([&] { model.covariance_blocks(columns, width, out.data()); },
                            {"width = " + std::to_string(width) + ": 2 columns"});
  }
}

TEST(LinearModel, OfNothingIsRefused) {
  support::expect_refused([] { LinearModel(Problem{}, SolveOptions{}); }, {"there are none"});
}

TEST(LinearModel, IsThatOfTheStateItIsGiven) {
  const OwnedProblem scene = make_circle_scene(support::perturbed(CameraModelId::kPerspective));
  optim::State state = state_of(scene.view());
  const SolveSummary summary = solve(scene.view(), {}, {}, state);
  EXPECT_EQ(LinearModel(scene.view(), {}).cost(), summary.minimizer.initial_cost);
  LinearModel there(scene.view(), {}, state);
  EXPECT_EQ(there.cost(), summary.minimizer.final_cost);
  OwnedProblem solved = scene;
  solved.start_from(state);
  std::vector<double> leverages(4UL * there.num_observations()), expected(leverages);
  there.leverages(leverages.data());
  LinearModel(solved.view(), {}).leverages(expected.data());
  EXPECT_EQ(leverages, expected);
}

TEST(LinearModel, ARidgeThatIsNoShareIsRefused) {
  const OwnedProblem owned = make_circle_scene(support::perturbed(CameraModelId::kCalibrated));
  for (double ridge :
       {-1.0, std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    support::expect_refused([&] { LinearModel(owned.view(), SolveOptions{}, ridge); },
                            {"ridge = ", "must be finite and not negative"});
  }
}

TEST(LinearModel, AProjectiveProblemHasNoCovariance) {
  const OwnedProblem owned = make_circle_scene(support::perturbed(CameraModelId::kProjective));
  LinearModel model(owned.view(), SolveOptions{});
  const std::vector<int> columns{0};
  support::expect_refused([&] { model.covariance(columns); }, {"gauge of 15 degrees of freedom"});
}

}  // namespace
}  // namespace sfmcpp::ba::linear_model_test

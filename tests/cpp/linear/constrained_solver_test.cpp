// Linear algebra with constraints between cameras, near ones and ones that share no point, against
// dense matrices of the whole problem.
#include <ostream>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "sfmcpp/linear/block_jacobi.hpp"
#include "sfmcpp/linear/linear_solver.hpp"
#include "sfmcpp/linear/reduced_structure.hpp"
#include "support/block_diagonal.hpp"
#include "support/random_constraints.hpp"

namespace sfmcpp::linear {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using support::DenseSystem;
using support::LinearizedProblem;
using support::OwnedProblem;
using Kind = residuals::ConstraintKind;

constexpr LinearSolverKind kSolvers[] = {
    LinearSolverKind::kDense, LinearSolverKind::kSparse, LinearSolverKind::kIterative};

struct Case {
  const char* name;
  CameraModelId model;
  int groups = 0;
  bool some_fixed = false;
  bool fix_gauge = false;
};
void PrintTo(const Case& c, std::ostream* out) { *out << c.name; }

// Eight cameras of which only neighbours share points.
OwnedProblem make_scene(const Case& c) {
  support::SceneOptions options = support::perturbed(c.model);
  options.num_cameras = 8;
  options.num_points = 80;
  options.window = 2;
  options.num_groups = c.groups;
  if (c.model == CameraModelId::kPerspective) options.free_intrinsics = std::vector<int>{0, 2, 3};
  OwnedProblem scene = make_circle_scene(options);
  if (c.some_fixed) scene.fixed_cameras[2] = scene.fixed_cameras[3] = scene.fixed_points[0] = 1;
  const auto add = [&](residuals::ConstraintKind kind, std::vector<std::pair<int, int>> cameras) {
    scene.constraints.add(random_group(scene, kind, cameras));
  };
  add(Kind::kPosition, {{0, 1}, {0, 4}, {0, 6}});
  add(Kind::kDisplacementPose, {{0, 1}, {1, 5}, {7, 2}, {5, 2}});
  add(Kind::kScale, {{0, 4}, {2, 3}});
  add(Kind::kSmoothingReprojections, {{6, 3}});
  if (has_free_intrinsics(c.model)) add(Kind::kFocal, {{0, 1}, {0, 2}});
  if (c.model == CameraModelId::kPerspective) add(Kind::kPrincipalPoint, {{0, 0}, {0, 1}, {0, 5}});
  return scene;
}

class ConstrainedSolver : public testing::TestWithParam<Case> {
 protected:
  VectorXd solution(LinearSolverKind kind, const Damping& damping) {
    Step step;
    EXPECT_TRUE(linearized.solve({kind, 1e-12, 5000}, damping, step).success);
    return flatten(dense, step);
  }
  static VectorXd vector(const std::vector<double>& values) {
    return Eigen::Map<const VectorXd>(values.data(), static_cast<Eigen::Index>(values.size()));
  }
  static void expect_close(const VectorXd& actual, const VectorXd& expected, double tolerance) {
    ASSERT_EQ(actual.size(), expected.size());
    EXPECT_LT((actual - expected).norm(), tolerance * expected.norm());
  }

  LinearizedProblem linearized{make_scene(GetParam()), GetParam().fix_gauge};
  DenseSystem dense = make_constrained_system(linearized);
  VectorXd b = dense.jacobian.transpose() * dense.residual;
  const NormalEquations& normal = linearized.normal();
};

TEST_P(ConstrainedSolver, GradientAndDiagonalCountTheConstraints) {
  const Eigen::Index n = dense.camera_columns;
  expect_close(vector(normal.camera_rhs()), b.head(n), 1e-12);
  const VectorXd diagonal = dense.jacobian.colwise().squaredNorm();
  expect_close(vector(normal.camera_diagonal()), diagonal.head(n), 1e-12);
  EXPECT_NEAR(normal.gradient_max_norm(), b.cwiseAbs().maxCoeff(), 1e-9 * b.norm());
  EXPECT_NEAR(normal.max_diagonal(), diagonal.maxCoeff(), 1e-9 * diagonal.maxCoeff());
}

TEST_P(ConstrainedSolver, SlopesAndCurvatureCountTheConstraints) {
  const Step step = support::random_step(linearized, 9);
  const VectorXd delta = flatten(dense, step);
  const Slopes slopes = normal.slopes(step);
  EXPECT_NEAR((slopes.camera + slopes.point) / -b.dot(delta), 1.0, 1e-10);
  EXPECT_NEAR(normal.curvature(step) / (dense.jacobian * delta).squaredNorm(), 1.0, 1e-10);
  EXPECT_NEAR(normal.model_decrease(step) / model_decrease(dense, delta), 1.0, 1e-10);
}

TEST_P(ConstrainedSolver, EverySolverAgreesWithQr) {
  for (const Damping& damping : {Damping{1e-3, DampingMatrix::kDiagonal},
                                 Damping{10.0, DampingMatrix::kDiagonal},
                                 Damping{1e3, DampingMatrix::kIdentity}}) {
    const VectorXd reference = solve_by_qr(dense, damping);
    for (LinearSolverKind kind : kSolvers) {
      const double tolerance = kind == LinearSolverKind::kIterative ? 1e-6 : 1e-9;
      SCOPED_TRACE(std::string(enum_name(kind)) + ", " + std::to_string(damping.lambda));
      expect_close(solution(kind, damping), reference, tolerance);
    }
  }
}

TEST_P(ConstrainedSolver, PredictedDecreaseIsThatOfTheDenseModel) {
  for (LinearSolverKind kind : kSolvers) {
    const Damping damping{1e-2, DampingMatrix::kDiagonal};
    Step step;
    ASSERT_TRUE(linearized.solve({kind, 1e-2, 5000}, damping, step).success);
    const double expected = model_decrease(dense, flatten(dense, step));
    EXPECT_GT(expected, 0.0);
    EXPECT_NEAR(normal.predicted_decrease(step, damping) / expected, 1.0, 1e-7);
  }
}

TEST_P(ConstrainedSolver, BlockJacobiHoldsTheDiagonalBlocksOfAllResiduals) {
  const Step g = support::random_step(linearized, 3);
  const Damping damping{1e-3, DampingMatrix::kDiagonal};
  BlockJacobi jacobi(normal);
  jacobi.factor(damping);
  Step step;
  jacobi.solve(g, step);
  const MatrixXd blocks = block_diagonal(linearized, dense, damped_matrix(dense, damping));
  expect_close(flatten(dense, step), blocks.ldlt().solve(flatten(dense, g)), 1e-9);
}

TEST_P(ConstrainedSolver, SweepLowersTheQuadraticModel) {
  for (double lambda : {1e-6, 1e-2, 1e2}) {
    BlockJacobi jacobi(normal);
    jacobi.factor({lambda, DampingMatrix::kDiagonal});
    Step step;
    jacobi.sweep(step);
    EXPECT_GT(model_decrease(dense, flatten(dense, step)), 0.0);
  }
}

TEST_P(ConstrainedSolver, ThreadsDoNotChangeABit) {
  const LinearizedProblem threaded(make_scene(GetParam()), GetParam().fix_gauge, 3);
  for (LinearSolverKind kind : kSolvers) {
    const Damping damping{1e-3, DampingMatrix::kDiagonal};
    Step one, three;
    ASSERT_TRUE(linearized.solve({kind, 1e-3, 5000}, damping, one).success);
    ASSERT_TRUE(threaded.solve({kind, 1e-3, 5000}, damping, three).success);
    EXPECT_EQ(one.camera, three.camera) << enum_name(kind);
    EXPECT_EQ(one.point, three.point) << enum_name(kind);
  }
}

INSTANTIATE_TEST_SUITE_P(
    Problems,
    ConstrainedSolver,
    testing::Values(Case{"Calibrated", CameraModelId::kCalibrated},
                    Case{"CalibratedSomeFixed", CameraModelId::kCalibrated, 0, true},
                    Case{"CalibratedGaugeFixed", CameraModelId::kCalibrated, 0, false, true},
                    Case{"PerspectivePrivate", CameraModelId::kPerspective},
                    Case{"PerspectiveShared", CameraModelId::kPerspective, 3},
                    Case{"PerspectiveOneForAllSomeFixed", CameraModelId::kPerspective, 1, true},
                    Case{"BalPrivate", CameraModelId::kBal},
                    Case{"BalShared", CameraModelId::kBal, 2, true}),
    [](const auto& test) { return std::string(test.param.name); });

TEST(CameraPattern, HasABlockForEveryPairWhetherItSharesAPointOrNot) {
  const LinearizedProblem work(make_scene({"", CameraModelId::kCalibrated}));
  const CameraPairs pairs{{5, 1}, {0, 1}, {3, 3}};
  const CameraPattern without = make_camera_pattern(work.graph);
  const CameraPattern with = make_camera_pattern(work.graph, pairs);
  ASSERT_EQ(with.num_blocks(), without.num_blocks() + 1);  // cameras 0 and 1 share points
  const std::vector<int> row(with.column.begin() + with.row_begin[1],
                             with.column.begin() + with.row_begin[2]);
  EXPECT_EQ(row, (std::vector<int>{1, 2, 5}));
}

}  // namespace
}  // namespace sfmcpp::linear

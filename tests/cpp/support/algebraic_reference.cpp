#include "support/algebraic_reference.hpp"

#include <array>
#include <cmath>

#include <Eigen/Geometry>
#include <Eigen/LU>

#include "sfmcpp/math/so3.hpp"
#include "support/camera_dispatch.hpp"
#include "support/whitening_factor.hpp"

namespace sfmcpp::support {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;
using Eigen::Vector4d;
using Eigen::VectorXd;

int camera_of(const LinearizedProblem& work, int k) { return work.problem.camera_index[k]; }

std::span<const double> intrinsics_of(const LinearizedProblem& work, int k) {
  const int count = work.problem.num_intrinsics();
  const int row = work.problem.intrinsics_index[camera_of(work, k)];
  return {work.state.intrinsics.data() + count * row, static_cast<std::size_t>(count)};
}

const double* stored_camera(const LinearizedProblem& work, int k) {
  return work.state.cameras.data() + kCameraStorage * camera_of(work, k);
}

Matrix3d pinhole(CameraModelId model, std::span<const double> intrinsics) {
  if (model != CameraModelId::kBal) return calibration_matrix(intrinsics);
  return Vector3d(intrinsics[0], intrinsics[0], 1.0).asDiagonal();
}

// What a step does to the unknowns of the camera of observation k: its tangent, and a full row of
// intrinsics.
struct CameraStep {
  VectorXd tangent, intrinsics;
};

CameraStep camera_step(const LinearizedProblem& work, const linear::Step& step, int k) {
  const int* columns = work.map.columns_of(camera_of(work, k));
  const auto value = [&](int c) {
    return columns[c] == linear::kNoColumn ? 0.0 : step.camera[columns[c]];
  };
  const int tangent = camera_tangent(work.problem.camera_model);
  CameraStep result{VectorXd(tangent), VectorXd::Zero(work.problem.num_intrinsics())};
  for (int c = 0; c < tangent; ++c) result.tangent[c] = value(c);
  for (std::size_t c = 0; c < work.free_intrinsics.size(); ++c)
    result.intrinsics[work.free_intrinsics[c]] = value(tangent + static_cast<int>(c));
  return result;
}

// dK/dα of K(intrinsics + α change): K is quadratic in them at most, so that the central difference
// is exact.
Matrix3d pinhole_change(CameraModelId model,
                        std::span<const double> intrinsics,
                        const VectorXd& change) {
  const Eigen::Map<const VectorXd> now(intrinsics.data(), change.size());
  const VectorXd ahead = now + change, behind = now - change;
  const auto size = static_cast<std::size_t>(change.size());
  return 0.5 * (pinhole(model, {ahead.data(), size}) - pinhole(model, {behind.data(), size}));
}

// docs/equations.md §5: ΔP = K [−[δR]× Rᵀ | [δR]× Rᵀ c − Rᵀ δc] + ΔK [Rᵀ | −Rᵀc].
Matrix34 metric_change(const LinearizedProblem& work, const CameraStep& step, int k) {
  const Matrix34 view = view_matrix(stored_camera(work, k));
  const Matrix3d turn = skew(step.tangent.head<3>());
  Matrix34 view_change = -turn * view;
  view_change.col(3) -= view.leftCols<3>() * step.tangent.tail<3>();
  const CameraModelId model = work.problem.camera_model.compiled();
  const std::span<const double> intrinsics = intrinsics_of(work, k);
  return pinhole(model, intrinsics) * view_change +
         pinhole_change(model, intrinsics, step.intrinsics) * view;
}

Matrix34 matrix_to_pixels(const LinearizedProblem& work, int k) {
  if (is_metric(work.problem.camera_model)) return pinhole_matrix(work, k);
  return frame_matrix(intrinsics_of(work, k)) * Eigen::Map<const Matrix34>(stored_camera(work, k));
}

Matrix34 change_to_pixels(const LinearizedProblem& work, const CameraStep& step, int k) {
  if (is_metric(work.problem.camera_model)) return metric_change(work, step, k);
  return frame_matrix(intrinsics_of(work, k)) * Eigen::Map<const Matrix34>(step.tangent.data());
}

// N of the image (thesis eq. 4.3, with the scale set right in docs/equations.md §5).
Matrix3d normalization(const ba::Problem& problem, int camera) {
  Vector2d centre = Vector2d::Zero();
  double distance = 0.0, count = 0.0;
  const auto for_each = [&](const auto& f) {
    for (int k = 0; k < problem.num_observations(); ++k) {
      if (problem.camera_index[k] == camera) f(Vector2d(problem.pixels.data() + 2L * k));
    }
  };
  for_each([&](const Vector2d& pixel) {
    centre += pixel;
    count += 1.0;
  });
  centre /= count;
  for_each([&](const Vector2d& pixel) { distance += (pixel - centre).norm() / count; });
  Matrix3d n;
  n << 1.0, 0.0, -centre.x(), 0.0, 1.0, -centre.y(), 0.0, 0.0, distance / std::sqrt(2.0);
  return n / n(2, 2);
}

// (X, 1), (δX, 0); or Q and the imaginary quaternion of the step times Q.
std::pair<Vector4d, Vector4d> point_and_change(const LinearizedProblem& work,
                                               const linear::Step& step,
                                               int k) {
  const int p = work.problem.point_index[k];
  const Vector3d delta(step.point.data() + 3L * p);
  if (is_metric(work.problem.camera_model)) {
    const Vector3d x(work.state.points.data() + 3L * p);
    return {x.homogeneous(), Vector4d(delta[0], delta[1], delta[2], 0.0)};
  }
  const Vector4d q(work.state.points.data() + 4L * p);
  const Eigen::Quaterniond product = Eigen::Quaterniond(0.0, delta[0], delta[1], delta[2]) *
                                     Eigen::Quaterniond(q[0], q[1], q[2], q[3]);
  return {q, Vector4d(product.w(), product.x(), product.y(), product.z())};
}

Eigen::Matrix2d residual_weight(const LinearizedProblem& work, const Loss& loss, int k) {
  const ba::Problem& problem = work.problem;
  const double* point = work.state.points.data() +
                        static_cast<long>(problem.point_storage()) * problem.point_index[k];
  const auto image = project(problem.camera_model.compiled(),
                             stored_camera(work, k),
                             intrinsics_of(work, k).data(),
                             point);
  const Eigen::Matrix2d factor = whitening_factor(problem, k);
  const Vector2d r =
      factor * Vector2d(problem.pixels[2 * k] - image.u, problem.pixels[2 * k + 1] - image.v);
  return std::sqrt(loss.derivative(r.squaredNorm())) * factor;
}

}  // namespace

Vector2d undistorted_pixel(const LinearizedProblem& work, int k) {
  const double* seen = work.problem.pixels.data() + 2L * k;
  Vector2d ideal;
  visit_camera(work.problem.camera_model, [&](auto type) {
    decltype(type)::template undistort<residuals::kLensSteps>(
        intrinsics_of(work, k).data(), seen[0], seen[1], ideal[0], ideal[1]);
  });
  return ideal;
}

Matrix34 pinhole_matrix(const LinearizedProblem& work, int k) {
  return pinhole(work.problem.camera_model.compiled(), intrinsics_of(work, k)) *
         view_matrix(stored_camera(work, k));
}

AlgebraicReference::AlgebraicReference(const LinearizedProblem& work,
                                       const linear::Step& step,
                                       ba::AlgebraicWeights weights,
                                       const Loss& loss) {
  std::vector<Matrix3d> normalizations;
  for (int i = 0; i < work.problem.num_cameras(); ++i)
    normalizations.push_back(normalization(work.problem, i));
  for (int k = 0; k < work.problem.num_observations(); ++k) {
    const Matrix3d& n = normalizations[camera_of(work, k)];
    Observation o;
    o.p = n * matrix_to_pixels(work, k);
    o.dp = n * change_to_pixels(work, camera_step(work, step, k), k);
    std::tie(o.q, o.dq) = point_and_change(work, step, k);
    const Vector3d seen = n * undistorted_pixel(work, k).homogeneous();
    // Rows of [q̂]× that give (projected − observed) in u and in v, times the depth.
    const Matrix3d cross = skew(seen);
    Eigen::Matrix<double, 2, 3> error;
    error << cross.row(1), -cross.row(0);
    o.s = residual_weight(work, loss, k) * error;
    if (weights == ba::AlgebraicWeights::kInverseDepth) o.s /= n(0, 0) * (o.p * o.q)[2];
    observations_.push_back(o);
  }
}

VectorXd AlgebraicReference::residuals(double x, double y) const {
  VectorXd result(2 * static_cast<Eigen::Index>(observations_.size()));
  for (std::size_t k = 0; k < observations_.size(); ++k) {
    const Observation& o = observations_[k];
    result.segment<2>(2 * static_cast<Eigen::Index>(k)) = o.s * (o.p + x * o.dp) * (o.q + y * o.dq);
  }
  return result;
}

}  // namespace sfmcpp::support

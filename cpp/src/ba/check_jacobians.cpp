#include "sfmcpp/ba/check_jacobians.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include <Eigen/Core>

#include "sfmcpp/ba/check.hpp"
#include "sfmcpp/linear/parameter_map.hpp"
#include "sfmcpp/math/numeric_diff.hpp"
#include "sfmcpp/residuals/function_images.hpp"
#include "sfmcpp/residuals/reprojection.hpp"

namespace sfmcpp::ba {
namespace {

using linear::kMaxCameraSize;

constexpr std::array<const char*, 6> kPoseNames{
    "rotation x", "rotation y", "rotation z", "centre x", "centre y", "centre z"};

std::string camera_parameter(const CameraModel& model, int k) {
  if (is_metric(model)) return kPoseNames[k];
  return "P[" + std::to_string(k / 4) + "," + std::to_string(k % 4) + "]";
}
constexpr std::array<const char*, 3> kPointNames{"point x", "point y", "point z"};

// One observation of the problem on its own, moved by (camera, intrinsics, point) increments.
class SingleObservation {
 public:
  SingleObservation(const Problem& problem, int observation)
      : kernels_(residuals::reprojection_kernels(problem.camera_model)),
        model_(problem.camera_model),
        tangent_(camera_tangent(model_)),
        num_intrinsics_(problem.num_intrinsics()),
        num_free_(has_free_intrinsics(model_) ? num_intrinsics_ : 0) {
    const int camera = problem.camera_index[observation], point = problem.point_index[observation];
    std::copy_n(
        problem.cameras.data() + problem.camera_offset(camera), kCameraStorage, camera_.begin());
    std::copy_n(problem.intrinsics.data() + problem.intrinsics_offset(camera),
                num_intrinsics_,
                intrinsics_.begin());
    std::copy_n(problem.points.data() + problem.point_offset(point),
                problem.point_storage(),
                point_.begin());
    u_.fill(problem.pixels[2 * static_cast<std::size_t>(observation)]);
    v_.fill(problem.pixels[2 * static_cast<std::size_t>(observation) + 1]);
    weight_.fill(1.0);
  }

  int size() const { return tangent_ + num_free_ + 3; }

  std::string name(int column) const {
    if (column < tangent_) return camera_parameter(model_, column);
    column -= tangent_;
    if (column < num_free_) return std::string(intrinsic_names(model_)[column]);
    return kPointNames[column - num_free_];
  }

  bool in_front() const {
    std::array<double, 1 + kReadAhead> ru, rv;
    return residual(batch(camera_, intrinsics_, point_), ru.data(), rv.data()) == 0;
  }

  // ∂(projection)/∂(camera, intrinsics, point).
  Eigen::MatrixXd analytic() const {
    std::array<int, 12> all;
    for (int k = 0; k < 12; ++k) all[k] = k;
    std::array<double, 2 * kMaxCameraSize> camera;
    std::array<double, residuals::kRecordSize> point;
    linearize(batch(camera_, intrinsics_, point_),
              {all.data(), num_free_, camera_columns(), camera.data(), point.data()});
    Eigen::MatrixXd jacobian(2, size());
    for (int row = 0; row < 2; ++row) {
      for (int k = 0; k < tangent_ + num_free_; ++k)
        jacobian(row, k) = camera[row * camera_columns() + k];
      for (int k = 0; k < 3; ++k)
        jacobian(row, tangent_ + num_free_ + k) = point[residuals::kRecordRow * row + k];
    }
    return jacobian;
  }

  Eigen::MatrixXd numeric() const {
    return numeric_jacobian([this](const Eigen::VectorXd& delta) { return projection(delta); },
                            steps());
  }

  // What rounding of pixels makes of numeric derivatives, for each parameter.
  Eigen::RowVectorXd rounding() const {
    const double pixel = std::max({std::abs(u_[0]), std::abs(v_[0]), 1.0});
    return std::numeric_limits<double>::epsilon() * pixel * steps().cwiseInverse().transpose();
  }

 private:
  using Numbers = std::array<double, kCameraStorage>;
  using PointNumbers = std::array<double, kMaxPointStorage>;

  int residual(const residuals::ObservationBatch& batch, double* ru, double* rv) const {
    if (model_.function() == nullptr) return kernels_.residuals(batch, ru, rv);
    imaged(batch, false).residuals(0, batch, ru, rv);
    return 0;
  }
  void linearize(const residuals::ObservationBatch& batch,
                 const residuals::JacobianOutput& out) const {
    if (model_.function() == nullptr) {
      kernels_.linearize(batch, out);
    } else {
      imaged(batch, true).linearize(0, batch, out);
    }
  }
  residuals::FunctionImages imaged(const residuals::ObservationBatch& batch,
                                   bool with_jacobians) const {
    residuals::FunctionImages image(*model_.function(), batch.count);
    image.set(0, batch);
    image.evaluate(with_jacobians);
    return image;
  }

  int camera_columns() const { return tangent_ + num_free_; }

  residuals::ObservationBatch batch(const Numbers& camera,
                                    const Numbers& intrinsics,
                                    const PointNumbers& point) const {
    static constexpr std::array<int, 1 + kReadAhead> kFirst{};
    return {camera.data(),
            intrinsics.data(),
            point.data(),
            kFirst.data(),
            u_.data(),
            v_.data(),
            weight_.data(),
            1};
  }

  // Up to a constant: the residual is observed − projected.
  Eigen::VectorXd projection(const Eigen::VectorXd& delta) const {
    Numbers camera, intrinsics = intrinsics_;
    PointNumbers point;
    plus_camera(model_, camera_.data(), delta.data(), camera.data());
    plus_point(model_, point_.data(), delta.data() + tangent_ + num_free_, point.data());
    for (int k = 0; k < num_free_; ++k) intrinsics[k] += delta[tangent_ + k];
    std::array<double, 1 + kReadAhead> ru, rv;
    residual(batch(camera, intrinsics, point), ru.data(), rv.data());
    return Eigen::Vector2d(-ru[0], -rv[0]);
  }

  // Small against what each parameter is measured by.
  Eigen::VectorXd steps() const {
    constexpr double kRelative = 1e-4, kOfIntrinsics = 1e-3;
    Eigen::VectorXd steps = Eigen::VectorXd::Constant(size(), kRelative);
    if (is_metric(model_)) {
      double distance = 1e-12;
      for (int k = 0; k < 3; ++k) distance += std::abs(point_[k] - camera_[4 * k + 3]);
      steps.segment<3>(3).setConstant(kRelative * distance);
      steps.tail<3>().setConstant(kRelative * distance);
    } else {
      steps.head(tangent_).setConstant(
          kRelative * Eigen::Map<const Eigen::VectorXd>(camera_.data(), kCameraStorage).norm());
    }
    for (int k = 0; k < num_free_; ++k)
      steps[tangent_ + k] = kOfIntrinsics * std::max(1.0, std::abs(intrinsics_[k]));
    return steps;
  }

  residuals::ReprojectionKernels kernels_;
  CameraModel model_;
  int tangent_;
  int num_intrinsics_;
  int num_free_;
  Numbers camera_{}, intrinsics_{};
  PointNumbers point_{};
  std::array<double, 1 + kReadAhead> u_{}, v_{}, weight_{};
};

struct Comparison {
  int observation;
  Eigen::MatrixXd analytic;
  Eigen::MatrixXd numeric;
  Eigen::RowVectorXd rounding;
};

// Of each column, the largest of what is finite.
Eigen::RowVectorXd largest_of_columns(const Eigen::MatrixXd& m) {
  return m.array().isFinite().select(m, 0.0).cwiseAbs().colwise().maxCoeff();
}

// A derivative that happens to vanish in one observation is judged by the size it has in others, or
// by what rounding lets a numeric one resolve: relative accuracy means nothing there.
void judge(const Problem& problem,
           const std::vector<Comparison>& comparisons,
           JacobianCheck& check) {
  constexpr double kSmall = 1e-2, kResolved = 1e9;
  if (comparisons.empty()) return;
  Eigen::RowVectorXd largest = Eigen::RowVectorXd::Zero(comparisons[0].numeric.cols());
  for (const Comparison& c : comparisons) largest = largest.cwiseMax(largest_of_columns(c.numeric));
  for (const Comparison& c : comparisons) {
    const Eigen::RowVectorXd scale =
        largest_of_columns(c.numeric).cwiseMax(kSmall * largest).cwiseMax(kResolved * c.rounding);
    // Those that are no numbers are infinitely wrong: NaN would compare with nothing.
    const Eigen::MatrixXd apart = (c.analytic - c.numeric).cwiseAbs();
    const Eigen::RowVectorXd errors = apart.array()
                                          .isNaN()
                                          .select(std::numeric_limits<double>::infinity(), apart)
                                          .colwise()
                                          .maxCoeff()
                                          .cwiseQuotient(scale);
    Eigen::Index column = 0;
    const double error = errors.maxCoeff(&column);
    check.entries += c.numeric.size();
    if (error <= check.worst_error) continue;
    check.worst_error = error;
    check.worst_observation = c.observation;
    check.worst_parameter =
        SingleObservation(problem, c.observation).name(static_cast<int>(column));
  }
}

}  // namespace

JacobianCheck check_jacobians(const Problem& problem, int max_observations) {
  check_arrays(problem);
  std::vector<Comparison> comparisons;
  const int count = std::min(max_observations, problem.num_observations());
  for (int k = 0; k < count; ++k) {
    const int observation =
        static_cast<int>(static_cast<long>(k) * problem.num_observations() / count);
    const SingleObservation single(problem, observation);
    if (single.in_front())
      comparisons.push_back({observation, single.analytic(), single.numeric(), single.rounding()});
  }
  JacobianCheck check;
  judge(problem, comparisons, check);
  return check;
}

}  // namespace sfmcpp::ba

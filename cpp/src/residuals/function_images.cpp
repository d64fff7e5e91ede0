#include "sfmcpp/residuals/function_images.hpp"

#include <algorithm>
#include <limits>

#include "sfmcpp/cameras/camera_concept.hpp"

namespace sfmcpp::residuals {
namespace {

using Space = MetricSpace;

const double* point_of(const ObservationBatch& batch, int k) {
  return batch.points + static_cast<long>(Space::kPointStorage) * batch.point[k];
}

}  // namespace

FunctionImages::FunctionImages(const CameraFunction& function, int count)
    : function_(function),
      num_intrinsics_(static_cast<int>(function.intrinsic_names().size())),
      count_(count),
      points_(3UL * count),
      intrinsics_(static_cast<std::size_t>(num_intrinsics_) * count),
      pixels_(2UL * count) {}

void FunctionImages::set(int first, const ObservationBatch& batch) {
  for (int k = 0; k < batch.count; ++k) {
    Space::to_camera(batch.camera, point_of(batch, k), point(first + k));
    std::copy_n(batch.intrinsics, num_intrinsics_, intrinsics(first + k));
  }
}

void FunctionImages::set_along(int first, const BendingBatch& batch, double length) {
  const ObservationBatch& seen = batch.observations;
  for (int k = 0; k < seen.count; ++k) {
    Jet<double> x[3];
    const double* step = batch.point_steps + 3L * seen.point[k];
    Space::to_camera_along(
        seen.camera, batch.camera_step, batch.camera_bend, point_of(seen, k), step, x);
    for (int i = 0; i < 3; ++i)
      point(first + k)[i] = x[i].value + length * (x[i].first + 0.5 * length * x[i].second);
    for (int i = 0; i < num_intrinsics_; ++i)
      intrinsics(first + k)[i] = seen.intrinsics[i] + length * batch.intrinsics_step[i];
  }
}

// What the function does not write is no number: zeros would pass for derivatives at a minimum.
void FunctionImages::evaluate(bool with_jacobians) {
  constexpr double kUnwritten = std::numeric_limits<double>::quiet_NaN();
  pixels_.assign(2UL * count_, kUnwritten);
  if (with_jacobians) {
    by_point_.assign(6UL * count_, kUnwritten);
    by_intrinsics_.assign(2UL * num_intrinsics_ * count_, kUnwritten);
  }
  const CameraFunction::Jacobians jacobians{by_point_.data(), by_intrinsics_.data()};
  function_.image(count_,
                  points_.data(),
                  intrinsics_.data(),
                  pixels_.data(),
                  with_jacobians ? &jacobians : nullptr);
}

void FunctionImages::residuals(int first,
                               const ObservationBatch& batch,
                               double* ru,
                               double* rv) const {
  for (int k = 0; k < batch.count; ++k) {
    ru[k] = (batch.u[k] - pixel(first + k)[0]) * batch.inverse_sigma[k];
    rv[k] = (batch.v[k] - pixel(first + k)[1]) * batch.inverse_sigma[k];
  }
}

void FunctionImages::linearize(int first,
                               const ObservationBatch& batch,
                               const JacobianOutput& out) const {
  const int used = Space::kTangent + out.num_free_intrinsics;
  for (int k = 0; k < batch.count; ++k) {
    const double weight = batch.inverse_sigma[k];
    const double* x = points_.data() + 3L * (first + k);
    const double seen[2] = {batch.u[k], batch.v[k]};
    for (int row = 0; row < 2; ++row) {
      const long of_row = 2L * (first + k) + row;
      const double* a = by_point_.data() + 3 * of_row;
      const double* b = by_intrinsics_.data() + num_intrinsics_ * of_row;
      double* camera = out.camera + static_cast<long>(out.camera_size) * (2L * k + row);
      double* point = out.point + kRecordRow * (2L * k + row);
      Space::carry_to_world(
          batch.camera, x, weight * a[0], weight * a[1], weight * a[2], camera, point);
      for (int i = 0; i < out.num_free_intrinsics; ++i)
        camera[Space::kTangent + i] = weight * b[out.free_intrinsics[i]];
      std::fill(camera + used, camera + out.camera_size, 0.0);
      point[kResidualOfU] = weight * (seen[row] - pixel(first + k)[row]);
    }
  }
}

}  // namespace sfmcpp::residuals

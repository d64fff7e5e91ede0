// Compiled once per instruction set; see core/isa.hpp for what may be used here.
#include "packed_batch.hpp"
#include "sfmcpp/cameras/visit_camera.hpp"
#include "sfmcpp/residuals/reprojection.hpp"

namespace sfmcpp::residuals::SFMCPP_ISA {
namespace {

SFMCPP_INLINE int points_behind(const ObservationBatch& batch, int first, const Real& depth) {
  int behind = 0;
  for (int lane = 0; lane < lanes_left(batch.count, first); ++lane) behind += !(depth[lane] > 0.0);
  return behind;
}

template <class Camera>
int residuals(const ObservationBatch& batch, double* ru, double* rv) {
  int behind = 0;
  for (int first = 0; first < batch.count; first += kLanes) {
    Real point[Camera::kPointStorage];
    gather_point<Camera::kPointStorage>(batch, first, point);
    const ImagePoint<Real> image = Camera::project(batch.camera, batch.intrinsics, point);
    const Real weight = load<kLanes>(batch.inverse_sigma + first);
    store(ru + first, (load<kLanes>(batch.u + first) - image.u) * weight);
    store(rv + first, (load<kLanes>(batch.v + first) - image.v) * weight);
    behind += points_behind(batch, first, image.depth);
  }
  return behind;
}

template <class Camera>
int linearize(const ObservationBatch& batch, const JacobianOutput& out) {
  constexpr int kCamera = Camera::kTangent;
  const int size = out.camera_size;
  static_assert(kCamera + Camera::kIntrinsics <= kMaxCameraColumns);
  Transposer<2 * kMaxCameraColumns> camera;
  Transposer<kRecordSize> point;
  for (int c = 0; c < 2 * size; ++c) camera.set(c, Real(0.0));
  int behind = 0;
  for (int first = 0; first < batch.count; first += kLanes) {
    Real x[Camera::kPointStorage];
    prefetch_points<Camera::kPointStorage>(batch, first);
    gather_point<Camera::kPointStorage>(batch, first, x);
    LinearizedImagePoint<Real, kCamera, Camera::kIntrinsics> lin;
    Camera::linearize(batch.camera, batch.intrinsics, x, lin);
    const Real weight = load<kLanes>(batch.inverse_sigma + first);
    const Real residual[2] = {load<kLanes>(batch.u + first) - lin.image.u,
                              load<kLanes>(batch.v + first) - lin.image.v};
    for (int row = 0; row < 2; ++row) {
      for (int k = 0; k < kCamera; ++k) camera.set(row * size + k, lin.camera[row][k] * weight);
      for (int k = 0; k < out.num_free_intrinsics; ++k) {
        camera.set(row * size + kCamera + k, lin.intrinsics[row][out.free_intrinsics[k]] * weight);
      }
      for (int k = 0; k < 3; ++k) point.set(kRecordRow * row + k, lin.point[row][k] * weight);
      point.set(kRecordRow * row + kResidualOfU, residual[row] * weight);
    }
    const int lanes = lanes_left(batch.count, first);
    camera.write(2 * size, lanes, out.camera + static_cast<long>(first) * 2 * size);
    point.write(kRecordSize, lanes, out.point + long{kRecordSize} * first);
    behind += points_behind(batch, first, lin.image.depth);
  }
  return behind;
}

}  // namespace

ReprojectionKernels kernels_for(CameraModelId model) {
  return visit_camera(model, [](auto camera) {
    using Camera = decltype(camera);
    return ReprojectionKernels{&residuals<Camera>, &linearize<Camera>};
  });
}

}  // namespace sfmcpp::residuals::SFMCPP_ISA

// Compiled once per instruction set; see core/isa.hpp for what may be used here.
#include "packed_batch.hpp"
#include "sfmcpp/cameras/visit_camera.hpp"
#include "sfmcpp/residuals/reprojection.hpp"

namespace sfmcpp::residuals::SFMCPP_ISA {
namespace {

template <class Camera>
void bend(const BendingBatch& batch, double* u, double* v) {
  constexpr int kNumbers = Camera::kIntrinsicNames.size();
  const ObservationBatch& seen = batch.observations;
  Jet<Real> intrinsics[kNumbers];
  for (int k = 0; k < kNumbers; ++k)
    intrinsics[k] = {Real(seen.intrinsics[k]), Real(batch.intrinsics_step[k]), Real(0.0)};
  for (int first = 0; first < seen.count; first += kLanes) {
    Real point[Camera::kPointStorage], step[3];
    gather_point<Camera::kPointStorage>(seen, first, point);
    for (int k = 0; k < 3; ++k)
      step[k] = gather<kLanes>(batch.point_steps + k, seen.point + first, 3);
    Jet<Real> image_u, image_v;
    Camera::project_along(seen.camera,
                          batch.camera_step,
                          batch.camera_bend,
                          intrinsics,
                          point,
                          step,
                          image_u,
                          image_v);
    const Real weight = load<kLanes>(seen.inverse_sigma + first);
    store(u + first, image_u.second * weight);
    store(v + first, image_v.second * weight);
  }
}

}  // namespace

BendingKernel bending_kernel_for(CameraModelId model) {
  return visit_camera(model, [](auto camera) { return BendingKernel{&bend<decltype(camera)>}; });
}

}  // namespace sfmcpp::residuals::SFMCPP_ISA

// Compiled once per instruction set; see core/isa.hpp for what may be used here.
#include "packed_batch.hpp"
#include "sfmcpp/cameras/visit_camera.hpp"
#include "sfmcpp/residuals/reprojection.hpp"

namespace sfmcpp::residuals::SFMCPP_ISA {
namespace {

template <int kNumbers>
SFMCPP_INLINE void gather_rows(const double* base, const int* row, Real* numbers) {
  for (int k = 0; k < kNumbers; ++k) numbers[k] = gather<kLanes>(base + k, row, kNumbers);
}

// Columns of the camera and its intrinsics are not read, and so not computed.
template <class Camera>
void linearize(const PlaceBatch& batch, double* records) {
  constexpr int kCamera = 12, kNumbers = Camera::kIntrinsicNames.size();
  for (int first = 0; first < batch.count; first += kLanes) {
    Real camera[kCamera], intrinsics[kNumbers], place[Camera::kPointStorage];
    gather_rows<kCamera>(batch.cameras, batch.camera + first, camera);
    gather_rows<kNumbers>(batch.intrinsics, batch.intrinsics_row + first, intrinsics);
    gather_rows<Camera::kPointStorage>(batch.places, batch.place + first, place);
    LinearizedImagePoint<Real, Camera::kTangent, Camera::kIntrinsics> lin;
    Camera::linearize(camera, intrinsics, place, lin);
    const Real weight = load<kLanes>(batch.inverse_sigma + first);
    Transposer<kRecordSize> record;
    for (int k = 0; k < 3; ++k) {
      record.set(k, lin.point[0][k] * weight);
      record.set(kRecordRow + k, lin.point[1][k] * weight);
    }
    record.set(kResidualOfU, (load<kLanes>(batch.u + first) - lin.image.u) * weight);
    record.set(kResidualOfV, (load<kLanes>(batch.v + first) - lin.image.v) * weight);
    record.write(kRecordSize, lanes_left(batch.count, first), records + long{kRecordSize} * first);
  }
}

}  // namespace

PlaceKernel place_kernel_for(CameraModelId model) {
  return visit_camera(model, [](auto camera) { return PlaceKernel{&linearize<decltype(camera)>}; });
}

}  // namespace sfmcpp::residuals::SFMCPP_ISA

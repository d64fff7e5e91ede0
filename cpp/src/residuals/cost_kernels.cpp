// Compiled once per instruction set; see core/isa.hpp for what may be used here.
#include "packed_batch.hpp"
#include "sfmcpp/cameras/visit_camera.hpp"
#include "sfmcpp/residuals/reprojection.hpp"

namespace sfmcpp::residuals::SFMCPP_ISA {
namespace {

static_assert(kCostLanes % kLanes == 0);

SFMCPP_INLINE Real squared(Real ru, Real rv) { return ru * ru + rv * rv; }

// Of a pack: ‖r‖², and 1 where the point is not in front of the camera.
struct PackCost {
  Real squares;
  Real behind;
};

template <class Camera>
SFMCPP_INLINE PackCost pack_cost(const ObservationBatch& batch, int first) {
  Real point[Camera::kPointStorage];
  prefetch_points<Camera::kPointStorage>(batch, first);
  gather_point<Camera::kPointStorage>(batch, first, point);
  const ImagePoint<Real> image = Camera::project(batch.camera, batch.intrinsics, point);
  const Real weight = load<kLanes>(batch.inverse_sigma + first);
  const Real ru = (load<kLanes>(batch.u + first) - image.u) * weight;
  const Real rv = (load<kLanes>(batch.v + first) - image.v) * weight;
  const Real zero(0.0);
  return {squared(ru, rv), select_less(zero, image.depth, zero, Real(1.0))};
}

// Sums stay in the lanes until the end of the batch: no addition waits for another lane's.
template <class Camera>
BatchCost cost(const ObservationBatch& batch) {
  Real squares(0.0), rests(0.0), behind(0.0);
  int first = 0;
  for (; first + kLanes <= batch.count; first += kLanes) {
    const PackCost pack = pack_cost<Camera>(batch, first);
    add_compensated(squares, rests, pack.squares);
    behind += pack.behind;
  }
  if (first < batch.count) {
    const PackCost pack = pack_cost<Camera>(batch, first);
    const Real zero(0.0), left = lanes_in_batch(batch, first);
    add_compensated(squares, rests, select_less(zero, left, pack.squares, zero));
    behind += select_less(zero, left, pack.behind, zero);
  }
  BatchCost result{.squares = {}, .behind_camera = sum_of_lanes(behind)};
  store(result.squares.sums, squares);
  store(result.squares.rests, rests);
  return result;
}

void add_squares(int count, const double* records, SumOfSquares& sum) {
  Real sums = load<kLanes>(sum.sums), rests = load<kLanes>(sum.rests);
  for (int first = 0; first < count; first += kLanes) {
    Real ru(0.0), rv(0.0);
    for (int lane = 0; lane < kLanes && first + lane < count; ++lane) {
      ru.v[lane] = records[kRecordSize * (first + lane) + kResidualOfU];
      rv.v[lane] = records[kRecordSize * (first + lane) + kResidualOfV];
    }
    add_compensated(sums, rests, squared(ru, rv));
  }
  store(sum.sums, sums);
  store(sum.rests, rests);
}

}  // namespace

CostKernels cost_kernels_for(CameraModelId model) {
  return visit_camera(model, [](auto camera) {
    return CostKernels{&cost<decltype(camera)>, &add_squares};
  });
}

}  // namespace sfmcpp::residuals::SFMCPP_ISA

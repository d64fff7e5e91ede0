// Compiled once per instruction set; see core/isa.hpp for what may be used here.
#include "packed_batch.hpp"
#include "sfmcpp/cameras/visit_camera.hpp"
#include "sfmcpp/core/compensated_sum.hpp"
#include "sfmcpp/residuals/algebraic.hpp"
#include "sfmcpp/residuals/reprojection.hpp"

namespace sfmcpp::residuals::SFMCPP_ISA {
namespace {

// S v for q̂ = (u, v, 1), up to the order and sign of its rows.
struct Crossed {
  Real x, y;
};

SFMCPP_INLINE Crossed crossed(const Real* v, Real qu, Real qv) {
  return {v[0] - qu * v[2], v[1] - qv * v[2]};
}

SFMCPP_INLINE Real dot(Crossed a, Crossed b) { return a.x * b.x + a.y * b.y; }

SFMCPP_INLINE void multiply(const double* matrix, const Real* q, Real* out) {
  for (int row = 0; row < 3; ++row) {
    const double* m = matrix + 4 * row;
    out[row] = q[0] * m[0] + q[1] * m[1] + q[2] * m[2] + q[3] * m[3];
  }
}

// The nine sums, lane by lane.
struct Sums {
  Real values[kAlgebraicSums] = {}, rests[kAlgebraicSums] = {};

  SFMCPP_INLINE void add(Crossed a, Crossed p, Crossed q, Crossed c) {
    const Real terms[kAlgebraicSums] = {dot(a, a),
                                        dot(a, p),
                                        dot(a, q),
                                        dot(p, p),
                                        dot(q, q),
                                        dot(p, q) + dot(a, c),
                                        dot(p, c),
                                        dot(q, c),
                                        dot(c, c)};
    for (int k = 0; k < kAlgebraicSums; ++k) add_compensated(values[k], rests[k], terms[k]);
  }

  AlgebraicSums total() const {
    AlgebraicSums out{};
    for (int k = 0; k < kAlgebraicSums; ++k) {
      for (int lane = 0; lane < kLanes; ++lane) {
        add_compensated(out.sums[k], out.rests[k], values[k][lane]);
        out.rests[k] += rests[k][lane];
      }
    }
    return out;
  }
};

template <class Camera, bool kShaped>
AlgebraicSums sums_of(const AlgebraicBatch& batch) {
  const ObservationBatch& seen = batch.observations;
  const double inverse_scale = 1.0 / batch.scale;
  Sums sums;
  for (int first = 0; first < seen.count; first += kLanes) {
    Real stored[Camera::kPointStorage], step[3], q[4], dq[4];
    gather_point<Camera::kPointStorage>(seen, first, stored);
    for (int k = 0; k < 3; ++k)
      step[k] = gather<kLanes>(batch.point_steps + k, seen.point + first, 3);
    Camera::homogeneous(stored, step, q, dq);
    Real u, v;
    Camera::template undistort<kLensSteps>(
        seen.intrinsics, load<kLanes>(seen.u + first), load<kLanes>(seen.v + first), u, v);
    const Real qu = (u - batch.centre_u) * inverse_scale;
    const Real qv = (v - batch.centre_v) * inverse_scale;
    Real pq[3], dpq[3], pdq[3], dpdq[3];
    multiply(batch.matrix, q, pq);
    multiply(batch.change, q, dpq);
    multiply(batch.matrix, dq, pdq);
    multiply(batch.change, dq, dpdq);
    Real weight = load<kLanes>(seen.inverse_sigma + first);
    if (batch.weigh_by_depth) weight = weight / pq[2] * batch.scale;
    const Real mask = lanes_in_batch(seen, first);
    const auto masked = [&](Crossed c) {
      if constexpr (kShaped) {
        c.y = load<kLanes>(batch.shapes.shear + first) * c.x +
              load<kLanes>(batch.shapes.stretch + first) * c.y;
      }
      return Crossed{select_less(Real(0.0), mask, c.x * weight, Real(0.0)),
                     select_less(Real(0.0), mask, c.y * weight, Real(0.0))};
    };
    sums.add(masked(crossed(pq, qu, qv)),
             masked(crossed(dpq, qu, qv)),
             masked(crossed(pdq, qu, qv)),
             masked(crossed(dpdq, qu, qv)));
  }
  return sums.total();
}

template <class Camera>
AlgebraicSums sums(const AlgebraicBatch& batch) {
  return batch.shapes.shear == nullptr ? sums_of<Camera, false>(batch)
                                       : sums_of<Camera, true>(batch);
}

}  // namespace

AlgebraicKernel algebraic_kernel_for(CameraModelId model) {
  return visit_camera(model, [](auto camera) { return AlgebraicKernel{&sums<decltype(camera)>}; });
}

}  // namespace sfmcpp::residuals::SFMCPP_ISA

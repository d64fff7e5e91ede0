// Compiled once per instruction set; see core/isa.hpp for what may be used here.
#include "packed_batch.hpp"
#include "sfmcpp/cameras/visit_camera.hpp"
#include "sfmcpp/math/inverse_factor.hpp"
#include "sfmcpp/residuals/reprojection.hpp"

namespace sfmcpp::residuals::SFMCPP_ISA {
namespace {

static_assert(kPlaceLanes % kLanes == 0);

template <int kNumbers>
SFMCPP_INLINE void gather_rows(const double* base, const int* row, Real* numbers) {
  for (int k = 0; k < kNumbers; ++k) numbers[k] = gather<kLanes>(base + k, row, kNumbers);
}

// Some lanes of one row.
template <class Camera>
struct Seen {
  static constexpr int kCamera = 12, kNumbers = Camera::kIntrinsicNames.size();

  Real camera[kCamera], intrinsics[kNumbers], u, v, weight;
  Real left;  // positive where the point has this row

  SFMCPP_INLINE Seen(const PlaceRows& rows, int row, int lane)
      : at_(long{kPlaceLanes} * row + lane), rows_(rows) {
    gather_rows<kCamera>(rows.cameras, rows.camera + at_, camera);
    gather_rows<kNumbers>(rows.intrinsics, rows.intrinsics_row + at_, intrinsics);
    u = load<kLanes>(rows.u + at_);
    v = load<kLanes>(rows.v + at_);
    weight = load<kLanes>(rows.inverse_sigma + at_);
    left = load<kLanes>(rows.count + lane) - (row + 0.5);
  }

  // What 1/σ_u has left to whiten; zero where there is nothing.
  SFMCPP_INLINE void whiten(Real& of_u, Real& of_v) const {
    if (rows_.shear != nullptr)
      of_v = load<kLanes>(rows_.shear + at_) * of_u + load<kLanes>(rows_.stretch + at_) * of_v;
    of_u = select_less(Real(0.0), left, of_u, Real(0.0));
    of_v = select_less(Real(0.0), left, of_v, Real(0.0));
  }

 private:
  long at_;
  const PlaceRows& rows_;
};

template <int kStorage>
SFMCPP_INLINE void load_place(const double* places, int lane, Real* place) {
  for (int k = 0; k < kStorage; ++k) place[k] = load<kLanes>(places + kPlaceLanes * k + lane);
}

// ρ and ρ′ of squared residuals.
SFMCPP_INLINE void weigh(const PlaceRows& rows, Real squared, Real& rho, Real& weight) {
  alignas(64) double numbers[3][kLanes];
  store(numbers[0], squared);
  rows.weigh(rows.loss, kLanes, numbers[0], numbers[1], numbers[2]);
  rho = load<kLanes>(numbers[1]);
  weight = load<kLanes>(numbers[2]);
}

template <class Camera>
void cost(const PlaceRows& rows, const double* places, double* costs) {
  for (int lane = 0; lane < kPlaceLanes; lane += kLanes) {
    Real place[Camera::kPointStorage], sum(0.0);
    load_place<Camera::kPointStorage>(places, lane, place);
    for (int row = 0; row < rows.num_rows; ++row) {
      const Seen<Camera> seen(rows, row, lane);
      const ImagePoint<Real> image = Camera::project(seen.camera, seen.intrinsics, place);
      Real ru = (seen.u - image.u) * seen.weight, rv = (seen.v - image.v) * seen.weight;
      seen.whiten(ru, rv);
      Real rho = ru * ru + rv * rv, unused;
      if (rows.weigh != nullptr) weigh(rows, rho, rho, unused);
      sum += rho;
    }
    store(costs + lane, sum);
  }
}

// Some lanes of the normal equations.
struct Sums {
  Real v[6], rhs[3], cost;

  SFMCPP_INLINE Sums() : cost(0.0) {
    for (Real& sum : v) sum = Real(0.0);
    for (Real& sum : rhs) sum = Real(0.0);
  }
  SFMCPP_INLINE void add_row(const Real* a, Real residual, Real weight) {
    int entry = 0;
    for (int k = 0; k < 3; ++k) {
      const Real weighted = a[k] * weight;
      for (int j = 0; j <= k; ++j) v[entry++] += weighted * a[j];
      rhs[k] += weighted * residual;
    }
  }
  SFMCPP_INLINE void store_in(PlaceFits& fits, int lane) const {
    for (int k = 0; k < 6; ++k) store(fits.v[k] + lane, v[k]);
    for (int k = 0; k < 3; ++k) store(fits.rhs[k] + lane, rhs[k]);
    store(fits.cost + lane, cost);
  }
};

// Columns of the camera and its intrinsics are not read, and so not computed.
template <class Camera>
void fit(const PlaceRows& rows, const double* places, PlaceFits& fits) {
  for (int lane = 0; lane < kPlaceLanes; lane += kLanes) {
    Real place[Camera::kPointStorage];
    load_place<Camera::kPointStorage>(places, lane, place);
    Sums sums;
    for (int row = 0; row < rows.num_rows; ++row) {
      const Seen<Camera> seen(rows, row, lane);
      LinearizedImagePoint<Real, Camera::kTangent, Camera::kIntrinsics> lin;
      Camera::linearize(seen.camera, seen.intrinsics, place, lin);
      Real a[2][3];
      for (int k = 0; k < 3; ++k) {
        a[0][k] = lin.point[0][k] * seen.weight;
        a[1][k] = lin.point[1][k] * seen.weight;
        seen.whiten(a[0][k], a[1][k]);
      }
      Real ru = (seen.u - lin.image.u) * seen.weight, rv = (seen.v - lin.image.v) * seen.weight;
      seen.whiten(ru, rv);
      Real rho = ru * ru + rv * rv, weight(1.0);
      if (rows.weigh != nullptr) weigh(rows, rho, rho, weight);
      sums.cost += rho;
      sums.add_row(a[0], ru, weight);
      sums.add_row(a[1], rv, weight);
    }
    sums.store_in(fits, lane);
  }
}

void step(const PlaceFits& fits,
          const double* lambda,
          double (*deltas)[kPlaceLanes],
          double* promises) {
  for (int lane = 0; lane < kPlaceLanes; lane += kLanes) {
    Real v[6], b[3], damping[3], y[3], delta[3];
    for (int k = 0; k < 6; ++k) v[k] = load<kLanes>(fits.v[k] + lane);
    for (int k = 0; k < 3; ++k) b[k] = load<kLanes>(fits.rhs[k] + lane);
    const Real diagonal[3] = {v[0], v[2], v[5]};
    for (int k = 0; k < 3; ++k)
      damping[k] = bounded_diagonal(diagonal[k]) * load<kLanes>(lambda + lane);
    const InverseFactor<Real> m(v, damping);
    multiply_by_factor(m, b, y);
    multiply_by_transposed_factor(m, y, delta);
    for (int k = 0; k < 3; ++k) store(deltas[k] + lane, delta[k]);
    store(promises + lane, b[0] * delta[0] + b[1] * delta[1] + b[2] * delta[2]);
  }
}

}  // namespace

PlaceKernels place_kernels_for(CameraModelId model) {
  return visit_camera(model, [](auto camera) {
    using Camera = decltype(camera);
    return PlaceKernels{&cost<Camera>, &fit<Camera>, &step};
  });
}

}  // namespace sfmcpp::residuals::SFMCPP_ISA

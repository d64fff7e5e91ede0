// Compiled once per instruction set; see core/isa.hpp for what may be used here.
#include "sfmcpp/cameras/visit_camera.hpp"
#include "sfmcpp/core/simd.hpp"
#include "sfmcpp/residuals/resection.hpp"

namespace sfmcpp::residuals::SFMCPP_ISA {
namespace {

constexpr int kLanes = SFMCPP_LANES;
using Real = Pack<kLanes>;
using Views = ViewArrays;
constexpr double kInfinity = __builtin_huge_val();

// J and r of a pack of observations.
struct Row {
  Real j[2][6];
  Real r[2];
};

SFMCPP_INLINE Real load_from(const double* values, int first) {
  return load<kLanes>(values + first);
}

SFMCPP_INLINE void load_point(const Views& views, int first, Real* point) {
  point[0] = load_from(views.x, first);
  point[1] = load_from(views.y, first);
  point[2] = load_from(views.z, first);
}

template <class Camera>
using Linearized = LinearizedImagePoint<Real, Camera::kTangent, Camera::kIntrinsics>;

SFMCPP_INLINE Row weighted(const Real (&j)[2][6], Real r_u, Real r_v, Real weight) {
  Row row;
  for (int k = 0; k < 6; ++k) {
    row.j[0][k] = j[0][k] * weight;
    row.j[1][k] = j[1][k] * weight;
  }
  row.r[0] = r_u * weight;
  row.r[1] = r_v * weight;
  return row;
}

SFMCPP_INLINE bool is_shaped(const Views& views) { return views.shapes.shear != nullptr; }

// What 1/σ_u leaves to whiten (whitening.hpp).
template <bool kShaped>
SFMCPP_INLINE void whiten_second([[maybe_unused]] const Views& views,
                                 [[maybe_unused]] int first,
                                 [[maybe_unused]] const Real& u,
                                 [[maybe_unused]] Real& v) {
  if constexpr (kShaped)
    v = load_from(views.shapes.shear, first) * u + load_from(views.shapes.stretch, first) * v;
}

template <class Camera, bool kShaped>
SFMCPP_INLINE Row observed_row(
    const Views& views, const double* intrinsics, const double* pose, int first, Real weight) {
  Real point[3];
  load_point(views, first, point);
  Linearized<Camera> at;
  Camera::linearize(pose, intrinsics, point, at);
  const Real u = load_from(views.u, first), v = load_from(views.v, first);
  Row row = weighted(at.camera, u - at.image.u, v - at.image.v, weight);
  for (int k = 0; k < 6; ++k) whiten_second<kShaped>(views, first, row.j[0][k], row.j[1][k]);
  whiten_second<kShaped>(views, first, row.r[0], row.r[1]);
  return row;
}

template <class Camera>
SFMCPP_INLINE Row row_between(const Views& views,
                              const double* intrinsics,
                              const double* pose,
                              const double* other,
                              bool same_centre,
                              int first) {
  Real point[3];
  load_point(views, first, point);
  Linearized<Camera> here, there;
  Camera::linearize(pose, intrinsics, point, here);
  Camera::linearize(other, intrinsics, point, there);
  for (int k = 3; k < 6 && same_centre; ++k) {
    here.camera[0][k] = here.camera[0][k] - there.camera[0][k];
    here.camera[1][k] = here.camera[1][k] - there.camera[1][k];
  }
  return weighted(here.camera,
                  there.image.u - here.image.u,
                  there.image.v - here.image.v,
                  load_from(views.inverse_sigma, first));
}

// One total per lane for each of the 28 sums, and room to make whole packs of them.
struct LaneSums {
  static constexpr int kSums = PoseSums::kNormal + PoseSums::kGradient + 1;
  static constexpr int kPacks = (kSums + kLanes - 1) / kLanes;
  Real lanes[kPacks * kLanes];

  SFMCPP_INLINE LaneSums() {
    for (Real& sum : lanes) sum = Real(0.0);
  }

  SFMCPP_INLINE void add(const Row& row) {
    int next = 0;
    for (int a = 0; a < 6; ++a) {
      for (int b = 0; b <= a; ++b)
        lanes[next++] += row.j[0][a] * row.j[0][b] + row.j[1][a] * row.j[1][b];
    }
    for (int a = 0; a < 6; ++a) lanes[next++] += row.j[0][a] * row.r[0] + row.j[1][a] * row.r[1];
    lanes[next] += row.r[0] * row.r[0] + row.r[1] * row.r[1];
  }

  // Transposing turns the sum over lanes of several totals into sums of packs.
  SFMCPP_INLINE void totals(PoseSums& out) {
    alignas(64) double flat[kPacks * kLanes];
    for (int pack = 0; pack < kPacks; ++pack) {
      Real* rows = lanes + pack * kLanes;
      transpose<kLanes>(rows);
      Real total = rows[0];
      for (int lane = 1; lane < kLanes; ++lane) total += rows[lane];
      store(flat + pack * kLanes, total);
    }
    for (int k = 0; k < PoseSums::kNormal; ++k) out.normal[k] = flat[k];
    for (int k = 0; k < PoseSums::kGradient; ++k) out.gradient[k] = flat[PoseSums::kNormal + k];
    out.cost = flat[kSums - 1];
  }
};

template <class Camera, bool kShaped>
void sums_of(const Views& views,
             const double* intrinsics,
             const double* pose,
             const double* inverse_sigma,
             PoseSums& out) {
  LaneSums totals;
  for (int first = 0; first < views.padded; first += kLanes) {
    const Real weight = load_from(inverse_sigma, first);
    totals.add(observed_row<Camera, kShaped>(views, intrinsics, pose, first, weight));
  }
  totals.totals(out);
}

template <class Camera>
void sums(const Views& views,
          const double* intrinsics,
          const double* pose,
          const double* inverse_sigma,
          PoseSums& out) {
  if (is_shaped(views)) return sums_of<Camera, true>(views, intrinsics, pose, inverse_sigma, out);
  sums_of<Camera, false>(views, intrinsics, pose, inverse_sigma, out);
}

template <class Camera>
void sums_between(const Views& views,
                  const double* intrinsics,
                  const double* pose,
                  const double* other,
                  bool same_centre,
                  PoseSums& out) {
  LaneSums totals;
  for (int first = 0; first < views.padded; first += kLanes)
    totals.add(row_between<Camera>(views, intrinsics, pose, other, same_centre, first));
  totals.totals(out);
}

template <class Camera, bool kShaped>
void rows_of(const Views& views, const double* intrinsics, const double* pose, double* out) {
  for (int first = 0; first < views.padded; first += kLanes) {
    const Real weight = load_from(views.inverse_sigma, first);
    const Row row = observed_row<Camera, kShaped>(views, intrinsics, pose, first, weight);
    for (int k = 0; k < 12; ++k) store(out + k * views.padded + first, row.j[k / 6][k % 6]);
    for (int k = 0; k < 2; ++k) store(out + (12 + k) * views.padded + first, row.r[k]);
  }
}

template <class Camera>
void rows(const Views& views, const double* intrinsics, const double* pose, double* out) {
  if (is_shaped(views)) return rows_of<Camera, true>(views, intrinsics, pose, out);
  rows_of<Camera, false>(views, intrinsics, pose, out);
}

template <class Camera, bool kShaped>
void errors_of(const Views& views, const double* intrinsics, const double* pose, double* out) {
  for (int first = 0; first < views.padded; first += kLanes) {
    Real point[3];
    load_point(views, first, point);
    const ImagePoint<Real> image = Camera::project(pose, intrinsics, point);
    const Real weight = load_from(views.inverse_sigma, first);
    const Real u = (load_from(views.u, first) - image.u) * weight;
    Real v = (load_from(views.v, first) - image.v) * weight;
    whiten_second<kShaped>(views, first, u, v);
    const Real error = select_less(Real(0.0), image.depth, u * u + v * v, Real(kInfinity));
    store(out + first, error);
  }
}

template <class Camera>
void squared_errors(const Views& views, const double* intrinsics, const double* pose, double* out) {
  if (is_shaped(views)) return errors_of<Camera, true>(views, intrinsics, pose, out);
  errors_of<Camera, false>(views, intrinsics, pose, out);
}

// W applied to both rows of J.
SFMCPP_INLINE void whitened(const Real (&j)[2][6], const double* whitener, Real (&z)[2][6]) {
  for (int a = 0; a < 6; ++a) {
    z[0][a] = z[1][a] = Real(0.0);
    for (int b = 0; b <= a; ++b) {
      const double w = *whitener++;
      z[0][a] += j[0][b] * w;
      z[1][a] += j[1][b] * w;
    }
  }
}

SFMCPP_INLINE Real dot(const Real (&a)[6], const Real (&b)[6]) {
  Real sum(0.0);
  for (int k = 0; k < 6; ++k) sum += a[k] * b[k];
  return sum;
}

void predicted_errors(
    const double* rows, int padded, const double* whitener, const double* shift, double* errors) {
  for (int first = 0; first < padded; first += kLanes) {
    Row row;
    for (int k = 0; k < 12; ++k) row.j[k / 6][k % 6] = load_from(rows + k * padded, first);
    for (int k = 0; k < 2; ++k) {
      row.r[k] = load_from(rows + (12 + k) * padded, first);
      for (int c = 0; c < 6; ++c) row.r[k] = row.r[k] - row.j[k][c] * shift[c];
    }
    Real z[2][6];
    whitened(row.j, whitener, z);
    const Real a = Real(1.0) - dot(z[0], z[0]), b = dot(z[0], z[1]),
               c = Real(1.0) - dot(z[1], z[1]);
    const Real inverse = Real(1.0) / (a * c - b * b);
    const Real u = (c * row.r[0] + b * row.r[1]) * inverse;
    const Real v = (b * row.r[0] + a * row.r[1]) * inverse;
    store(errors + first, u * u + v * v);
  }
}

}  // namespace

ResectionKernels resection_kernels_for(CameraModelId model) {
  return visit_camera(model, [](auto camera) -> ResectionKernels {
    using Camera = decltype(camera);
    if constexpr (Camera::kMetric) {
      return {&sums<Camera>,
              &sums_between<Camera>,
              &rows<Camera>,
              &squared_errors<Camera>,
              &predicted_errors};
    } else {
      return {};
    }
  });
}

}  // namespace sfmcpp::residuals::SFMCPP_ISA

// Reprojection residuals of the observations of one camera, r = (observed − projected) / σ (note
// eq. 3), and their linearisation, for the camera model and instruction set chosen at run time.
#pragma once

#include "sfmcpp/cameras/camera_model.hpp"
#include "sfmcpp/core/compensated_sum.hpp"
#include "sfmcpp/core/isa.hpp"

namespace sfmcpp::residuals {

// Consecutive observations of one camera.
struct ObservationBatch {
  const double* camera;      // 12 numbers
  const double* intrinsics;  // one row
  const double* points;      // N × 3, all points
  const int* point;          // point of each observation
  const double* u;           // observed pixels
  const double* v;
  const double* inverse_sigma;
  int count;
};

// Columns of a camera block at most: those of pose and intrinsics, of the sensor of a rig, and
// padding.
inline constexpr int kMaxCameraColumns = 18;

// Where the Jacobian of a batch goes.
struct JacobianOutput {
  const int* free_intrinsics;  // which intrinsic parameters have a column, after those of the pose
  int num_free_intrinsics;
  int camera_size;  // columns of a camera block; those that are not written here are zero
  double* camera;   // count × 2 × camera_size: ∂(projection)/∂camera / σ
  double* point;    // count records
};

// What a kernel writes of an observation beside the derivatives by its camera: a row for u and one
// for v, each of three numbers ∂(projection)/∂point / σ and of the residual (linear::PointRecord).
inline constexpr int kRecordRow = 4;
inline constexpr int kRecordSize = 2 * kRecordRow;  // numbers
inline constexpr int kResidualOfU = kRecordRow - 1, kResidualOfV = kRecordSize - 1;

inline double squared_residual(const double* record) {
  const double ru = record[kResidualOfU], rv = record[kResidualOfV];
  return ru * ru + rv * rv;
}

struct ReprojectionKernels {
  // Both return how many points are not in front of the camera; their residual keeps the formula's
  // value. Residuals go into ru, rv, each with room for count + kReadAhead numbers.
  int (*residuals)(const ObservationBatch&, double* ru, double* rv);
  int (*linearize)(const ObservationBatch&, const JacobianOutput&);
};

// These and the others: of compiled models; null of a function (function_images.hpp).
ReprojectionKernels reprojection_kernels(const CameraModel& model);

// Σ ‖r‖² in compensated parts.
inline constexpr int kCostLanes = 8;
struct SumOfSquares {
  double sums[kCostLanes] = {};
  double rests[kCostLanes] = {};

  CompensatedSum total() const;
};
// Sums over a batch alone, where no residual is asked for.
struct BatchCost {
  SumOfSquares squares;
  double behind_camera;  // how many points are not in front of the camera
};

struct CostKernels {
  BatchCost (*cost)(const ObservationBatch&);
  // Adds ‖r‖² of `count` records. A batch may come in parts, all but the last a multiple of
  // kCostLanes long: the sum has then the bits of `cost`.
  void (*add_squares)(int count, const double* records, SumOfSquares& sum);
};

CostKernels cost_kernels(const CameraModel& model);

// Second derivatives of the projections of the observations of one camera along a step: that of α ↦
// projection(x ⊞ α δ) at α = 0, times the weight of the residual. Exact, by jets (math/jet.hpp)
// through the camera models.
struct BendingBatch {
  ObservationBatch observations;  // of one camera, with `inverse_sigma` their weights
  const double* camera_step;      // in the tangent of the camera
  const double* camera_bend;      // second derivatives of its turn and centre, in its axes: 6
  const double* intrinsics_step;  // for each stored intrinsic parameter, zero where it is fixed
  const double* point_steps;      // N × 3, in the tangents of all points
};

struct BendingKernel {
  // Into u, v, each with room for count + kReadAhead numbers.
  void (*bend)(const BendingBatch&, double* u, double* v);
};

BendingKernel bending_kernel(const CameraModel& model);

// Points side by side, kPlaceLanes of them, at places that are tried for them: row k has what each
// sees as number k, in any cameras. Entries beyond the last of a point do not count; their indices
// must be in range.
inline constexpr int kPlaceLanes = 8;

struct PlaceRows {
  const double* cameras;  // 12 numbers each
  const double* intrinsics;
  int num_rows;
  // kPlaceLanes in each row.
  const int* camera;
  const int* intrinsics_row;
  const double* u;  // observed pixels
  const double* v;
  const double* inverse_sigma;
  const double* shear;  // null where all Σ = σ²I (whitening.hpp), as is the next
  const double* stretch;
  const double* count;  // rows of each point
  // ρ and ρ′ of `count` squared residuals; null for least squares.
  void (*weigh)(const void* loss, int count, const double* squared, double* rho, double* weight);
  const void* loss;
};

// The normal equations of the points, number k of lane l at [k][l], and Σ ρ(‖r‖²).
struct PlaceFits {
  alignas(64) double v[6][kPlaceLanes];    // lower triangle of Σ ρ′ Aᵀ A, row by row
  alignas(64) double rhs[3][kPlaceLanes];  // Σ ρ′ Aᵀ r
  alignas(64) double cost[kPlaceLanes];
};

// For the camera model and instruction set chosen at run time; number k of the place of lane l is
// places[kPlaceLanes k + l].
struct PlaceKernels {
  void (*cost)(const PlaceRows&, const double* places, double* costs);
  void (*fit)(const PlaceRows&, const double* places, PlaceFits& fits);
  // Steps δ = (V + λD)⁻¹ b, D the diagonal of V and λ that of each lane, number k at [k][lane], and
  // what they promise to lower Σ ρ by: bᵀδ, with little damping.
  void (*step)(const PlaceFits& fits,
               const double* lambda,
               double (*deltas)[kPlaceLanes],
               double* promises);
};

PlaceKernels place_kernels(const CameraModel& model);

SFMCPP_DECLARE_FOR_EACH_ISA(ReprojectionKernels kernels_for(CameraModelId model))
SFMCPP_DECLARE_FOR_EACH_ISA(CostKernels cost_kernels_for(CameraModelId model))
SFMCPP_DECLARE_FOR_EACH_ISA(BendingKernel bending_kernel_for(CameraModelId model))
SFMCPP_DECLARE_FOR_EACH_ISA(PlaceKernels place_kernels_for(CameraModelId model))

}  // namespace sfmcpp::residuals

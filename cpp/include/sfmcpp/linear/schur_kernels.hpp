// The inner loops of the Schur complement, for the block size and instruction set chosen at run
// time.
//
// Notation of one observation a of point p in camera i (docs/equations.md §2; D = camera_size):
//   J  2×D  derivative by the camera, A  2×3  derivative by the point, r  2  residual
//   M  3×3  inverse Cholesky factor of the damped V: V*⁻¹ = Mᵀ M;   y = M b_p
//   G = A Mᵀ  (2×3),  r̄ = r − G y  (2)
// W_a V*⁻¹ W_bᵀ = J_aᵀ (G_a G_bᵀ) J_b has rank two, so W is never formed:
//   S_ij = [i = j] Σ Jᵀ J − Σ J_aᵀ (G_a G_bᵀ) J_b   over the points that i and j both see,
// the right-hand side is Σ Jᵀ r̄, and δp = Mᵀ (y − Σ Gᵀ J δc).
//
// G and r̄ are not stored either: they follow from A, r and the factor of the point. A is stored
// with r as its last column, the 2×4 matrix A|r: a record.
//
// J and A|r are stored in double or in single precision (precision.hpp); all else is double.
#pragma once

#include <span>

#include "sfmcpp/core/compensated_sum.hpp"
#include "sfmcpp/core/isa.hpp"
#include "sfmcpp/linear/precision.hpp"

namespace sfmcpp::linear {

// A|r of an observation, row after row (a cache line, or half of one).
template <class T>
struct PointRecordOf {
  struct Row {
    T by_point[3];
    T residual;
  };
  Row row[2];
};
using PointRecord = PointRecordOf<double>;

// J and A|r of every observation, in numbers that only kernels made for this precision read.
struct StoredJacobian {
  const void* by_camera;
  const void* records;
};

// M and y of a point.
struct PointFactor {
  double m00, m10, m11, m20, m21, m22;
  double y[3];
};

// Points seen by a camera, and cameras that see a point (ObservationGraph).
struct GraphView {
  const int* camera;
  const int* point;
  const int* point_begin;
  const int* of_point;
  const int* rank;
};

// Two observations of one point, the first in the earlier camera.
struct ObservationPair {
  int first, second;
};

// M and y of n points from V + λD and b, nine numbers of each; D is the diagonal of V or the
// identity.
using FactorPoints =
    void (*)(int n, const double* blocks, double lambda, bool identity, PointFactor* factors);

// Numbers that sums of pairs keep for each observation of camera i.
inline constexpr int kWhitenedNumbers = 8;

// What observations of a camera i add to the blocks (i, j), j > i, of S, in panel layout.
struct SchurRow {
  GraphView graph;
  int begin, end;  // observations of camera i
  StoredJacobian jacobian;
  const PointFactor* factors;  // M, y of every point
  const int* block_of_camera;  // number of block (i, j) among `blocks`
  double* blocks;              // added to
};

// The same with the pairs of observations given, by block, for some rows at once. With a grid
// (sum_grid.hpp), sums are taken on it.
struct PairSums {
  struct Row {
    int begin, end;                // observations of camera i
    double* whitened;              // room for kWhitenedNumbers of each
    const double* grid = nullptr;  // of camera i
  };
  struct Block {
    int row;      // number among the rows
    int column;   // camera j
    long end;     // of its pairs, which begin where those of the block before end
    double* sum;  // added to
  };
  std::span<const Row> rows;
  std::span<const Block> blocks;
  const ObservationPair* pairs = nullptr;
  const int* point = nullptr;  // of every observation
  StoredJacobian jacobian{};
  const PointFactor* factors = nullptr;
  const double* grid = nullptr;  // of every camera
};

// Block (i, i) of S and Σ Jᵀ r̄ of a camera, overwritten.
struct DiagonalSum {
  int begin, end;  // observations of camera i
  const int* point;
  StoredJacobian jacobian;
  const PointFactor* factors;
  const double* gradient;  // Σ Jᵀ r where the stored r is rounded, else null
  double* diagonal;
  double* rhs;
  // Of camera i: sums are taken on it then, and that of the right-hand side is compensated: what is
  // rounded off comes behind it, as behind the gradient if that is compensated too.
  const double* grid = nullptr;
  bool compensated_gradient = false;
};

// Observations [begin, end) are of one camera; `point` is that of every observation.
struct SchurKernels {
  // Over n observations before they are stored, Jᵀ r and the column sums of J∘J are added to
  // `sums`; compensated, what is rounded off of both is added behind them.
  void (*camera_gradient)(int n, const double* jacobian, const PointRecord* records, double* sums);
  void (*compensated_gradient)(int n,
                               const double* jacobian,
                               const PointRecord* records,
                               double* sums);
  void (*schur_row)(const SchurRow& row);
  // The same by lists of pairs, in a fraction of the time; null where a block does not fit into the
  // registers.
  void (*sum_pairs)(const PairSums& rows);
  // J of n observations as it is stored; A|r too, with Aᵀr less what the stored numbers make of it,
  // four numbers each, of which the last means nothing.
  void (*round_jacobian)(int n, const double* jacobian, void* stored);
  void (*round_records)(int n, const PointRecord* records, void* stored, float* lost);
  void (*schur_diagonal)(const DiagonalSum& sum);
  // Σ Gᵀ J x for the points [begin, end), with x of every camera in `steps`, D numbers each.
  void (*point_sums)(const GraphView& graph,
                     int begin,
                     int end,
                     const StoredJacobian& jacobian,
                     const PointFactor* factors,
                     const double* steps,
                     double* sums);
  // out += Jᵀ (J x − A t), with t of every point in `shifts`, three numbers each; compensated, with
  // what is rounded off behind it.
  void (*schur_product)(const StoredJacobian& jacobian,
                        int begin,
                        int end,
                        const int* point,
                        const double* shifts,
                        const double* x,
                        double* out);
  // sum += Σ ‖J x + A t‖², likewise.
  void (*curvature)(const StoredJacobian& jacobian,
                    int begin,
                    int end,
                    const int* point,
                    const double* shifts,
                    const double* x,
                    CompensatedSum& sum);
  // Σ Aᵀ h for the points [begin, end), with h of every observation in `residuals`, two numbers
  // each.
  void (*point_gradients)(const GraphView& graph,
                          int begin,
                          int end,
                          const StoredJacobian& jacobian,
                          const double* residuals,
                          double* gradients);
  // out += Jᵀ (h − A t) over the observations [begin, end), likewise, with t of every point in
  // `shifts`.
  void (*reduced_gradient)(const StoredJacobian& jacobian,
                           int begin,
                           int end,
                           const int* point,
                           const double* shifts,
                           const double* residuals,
                           double* out);
};

// `camera_size` must be one of padded_camera_size(), the precision not auto.
SchurKernels schur_kernels(int camera_size, Precision stored);

SFMCPP_DECLARE_FOR_EACH_ISA(FactorPoints factor_points_kernel())
SFMCPP_DECLARE_FOR_EACH_ISA(SchurKernels kernels_for(int camera_size, Precision stored))

}  // namespace sfmcpp::linear

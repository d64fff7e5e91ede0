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
// G and r̄ are not stored either: they follow from A|r and the factor of the point.
#pragma once

namespace sfmcpp::linear {

// A|r of an observation (a cache line).
struct PointRecord {
  struct Row {
    double by_point[3];
    double residual;
  };
  Row row[2];
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

// One block row of S: the blocks (i, j), j ≥ i, of camera i, in panel layout.
struct SchurRow {
  GraphView graph;
  int begin, end;              // observations of camera i
  const double* jacobian;      // J of every observation
  const PointRecord* records;  // A|r of every observation
  const PointFactor* factors;  // M, y of every point
  const int* block_of_camera;  // for j > i: number of block (i, j) among `blocks`
  double* diagonal;            // block (i, i); overwritten
  double* blocks;              // blocks (i, j), j > i; added to
  double* rhs;                 // D numbers; overwritten
};

struct SchurKernels {
  // gradient += Jᵀ r, diagonal += column sums of J∘J, over n observations.
  void (*camera_gradient)(int n,
                          const double* jacobian,
                          const PointRecord* records,
                          double* gradient,
                          double* diagonal);
  void (*schur_row)(const SchurRow& row);
  // Block (i, i) and the right-hand side alone, over the n observations of camera i.
  void (*schur_diagonal)(int n,
                         const double* jacobian,
                         const PointRecord* records,
                         const int* point,
                         const PointFactor* factors,
                         double* diagonal,
                         double* rhs);
  // Σ Gᵀ J x for the points [begin, end), with x of every camera in `steps`, D numbers each.
  void (*point_sums)(const GraphView& graph,
                     int begin,
                     int end,
                     const double* jacobian,
                     const PointRecord* records,
                     const PointFactor* factors,
                     const double* steps,
                     double* sums);
  // out += Jᵀ (J x − A t), with t of every point in `shifts`, three numbers each.
  void (*schur_product)(int n,
                        const double* jacobian,
                        const PointRecord* records,
                        const int* point,
                        const double* shifts,
                        const double* x,
                        double* out);
};

// `camera_size` must be one of padded_camera_size().
SchurKernels schur_kernels(int camera_size);

}  // namespace sfmcpp::linear

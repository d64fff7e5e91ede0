// The inner loops of the Schur complement, for the block size and instruction set chosen at run
// time.
//
// Notation of one observation a of point p in camera i (EQUATIONS §2; D = camera_size):
//   J  2×D  derivative by the camera, A  2×3  derivative by the point, r  2  residual
//   M  3×3  inverse Cholesky factor of the damped V: V*⁻¹ = Mᵀ M;   y = M b_p
//   G = A Mᵀ  (2×3),  P = Gᵀ J  (3×D): the coupling block Wᵀ, whitened by M
// Then  S_ij = [i = j] Σ Jᵀ J − Σ P_aᵀ P_b  over the points that i and j both see, the right-hand
// side is  Σ Jᵀ r − Σ Pᵀ y,  and  δp = Mᵀ (y − Σ P δc).
#pragma once

namespace sfmcpp::linear {

inline constexpr int kPointRecord =
    8;  // A|r: 2×4 row-major, the residual in the last column (a cache line)
inline constexpr int kPointFactor = 9;    // M (row-major lower triangle: 6), y (3)
inline constexpr int kWhitenedPoint = 6;  // G

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
  const double* coupling;      // P of every observation
  const double* factors;       // M, y of every point
  const int* block_of_camera;  // for j > i: number of block (i, j) among `blocks`
  double* diagonal;            // block (i, i); overwritten
  double* blocks;              // blocks (i, j), j > i; added to
  double* rhs;                 // −Σ Pᵀ y; overwritten
};

struct SchurKernels {
  // gradient += Jᵀ r, diagonal += column sums of J∘J, over n observations.
  void (*camera_gradient)(
      int n, const double* jacobian, const double* records, double* gradient, double* diagonal);

  // With the coupling blocks P stored: P of n observations; a row of S; Σ P δc for points [begin,
  // end), where `steps` holds δc of every camera, D numbers each.
  void (*couple)(int n,
                 const double* records,
                 const int* point,
                 const double* factors,
                 const double* jacobian,
                 double* coupling);
  void (*schur_row)(const SchurRow& row);
  void (*coupled_sums)(const GraphView& graph,
                       int begin,
                       int end,
                       const double* coupling,
                       const double* steps,
                       double* sums);

  // Without them: G of n observations; block (i, i) of S and −Σ Pᵀ y; e = J x; out += Jᵀ e.
  void (*whiten)(
      int n, const double* records, const int* point, const double* factors, double* whitened);
  void (*schur_diagonal)(int n,
                         const double* jacobian,
                         const double* whitened,
                         const int* point,
                         const double* factors,
                         double* diagonal,
                         double* rhs);
  void (*apply)(int n, const double* jacobian, const double* x, double* e);
  void (*apply_transposed)(int n, const double* jacobian, const double* e, double* out);
};

// `camera_size` must be one of padded_camera_size().
SchurKernels schur_kernels(int camera_size);

}  // namespace sfmcpp::linear

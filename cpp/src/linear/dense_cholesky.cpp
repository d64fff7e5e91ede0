#include "sfmcpp/linear/dense_cholesky.hpp"

#include <algorithm>
#include <cmath>

#ifdef SFMCPP_WITH_LAPACK
#include "sfmcpp/linear/blas_threads.hpp"

extern "C" {
void dpotrf_(const char* uplo, const int* n, double* a, const int* lda, int* info);
void dpotrs_(const char* uplo,
             const int* n,
             const int* nrhs,
             const double* a,
             const int* lda,
             double* b,
             const int* ldb,
             int* info);
void dtrsm_(const char* side,
            const char* uplo,
            const char* transa,
            const char* diag,
            const int* m,
            const int* n,
            const double* alpha,
            const double* a,
            const int* lda,
            double* b,
            const int* ldb);
void dsyrk_(const char* uplo,
            const char* trans,
            const int* n,
            const int* k,
            const double* alpha,
            const double* a,
            const int* lda,
            const double* beta,
            double* c,
            const int* ldc);
void dgemm_(const char* transa,
            const char* transb,
            const int* m,
            const int* n,
            const int* k,
            const double* alpha,
            const double* a,
            const int* lda,
            const double* b,
            const int* ldb,
            const double* beta,
            double* c,
            const int* ldc);
}
#else
#include <Eigen/Cholesky>
#endif

namespace sfmcpp::linear {
namespace {

#ifdef SFMCPP_WITH_LAPACK

constexpr double kOne = 1.0, kMinusOne = -1.0;

// Right-looking Cholesky by tiles.
class TiledCholesky {
 public:
  TiledCholesky(int n, double* matrix, ThreadPool& pool)
      : n_(n),
        tile_(n < kLarge ? 64 : 144),
        count_((n + tile_ - 1) / tile_),
        matrix_(matrix),
        pool_(pool) {}

  bool factor() {
    for (int k = 0; k < count_; ++k) {
      const int size = rows(k);
      int info = 0;
      dpotrf_("L", &size, at(k, k), &n_, &info);
      if (info != 0) return false;
      const int below = count_ - k - 1;
      pool_.parallel_for(below, [&](int task) { solve_panel(k, k + 1 + task); });
      pool_.parallel_for(below * (below + 1) / 2, [&](int task) { update(k, task); });
    }
    return true;
  }

 private:
  static constexpr int kLarge = 1500;

  int rows(int tile) const { return std::min(tile_, n_ - tile * tile_); }
  double* at(int row_tile, int column_tile) const {
    return matrix_ + static_cast<long>(column_tile) * tile_ * n_ +
           static_cast<long>(row_tile) * tile_;
  }

  // L_ik = A_ik L_kk⁻ᵀ
  void solve_panel(int k, int i) const {
    const int m = rows(i), n = rows(k);
    dtrsm_("R", "L", "T", "N", &m, &n, &kOne, at(k, k), &n_, at(i, k), &n_);
  }

  // A_ij −= L_ik L_jkᵀ for the task-th tile of the lower triangle that remains below tile k.
  void update(int k, int task) const {
    int i = 0;
    while ((i + 1) * (i + 2) / 2 <= task) ++i;
    const int j = task - i * (i + 1) / 2;
    const int row = k + 1 + i, column = k + 1 + j;
    const int m = rows(row), n = rows(column), inner = rows(k);
    if (row == column) {
      dsyrk_("L", "N", &m, &inner, &kMinusOne, at(row, k), &n_, &kOne, at(row, row), &n_);
    } else {
      dgemm_("N",
             "T",
             &m,
             &n,
             &inner,
             &kMinusOne,
             at(row, k),
             &n_,
             at(column, k),
             &n_,
             &kOne,
             at(row, column),
             &n_);
    }
  }

  const int n_;
  const int tile_;
  const int count_;
  double* matrix_;
  ThreadPool& pool_;
};

bool factor_and_solve(int n, double* matrix, std::span<double> x, ThreadPool& pool) {
  const SingleThreadedBlas single_threaded;
  if (!TiledCholesky(n, matrix, pool).factor()) return false;
  const int one = 1;
  int info = 0;
  dpotrs_("L", &n, &one, matrix, &n, x.data(), &n, &info);
  return info == 0;
}

#else

bool factor_and_solve(int n, double* matrix, std::span<double> x, ThreadPool&) {
  Eigen::Map<Eigen::MatrixXd> a(matrix, n, n);
  Eigen::LLT<Eigen::Ref<Eigen::MatrixXd>, Eigen::Lower> cholesky(a);
  if (cholesky.info() != Eigen::Success) return false;
  Eigen::Map<Eigen::VectorXd> b(x.data(), n);
  cholesky.solveInPlace(b);
  return true;
}

#endif

}  // namespace

bool dense_cholesky_solve(int n, double* matrix, std::span<double> x, ThreadPool& pool) {
  if (n == 0) return true;
  if (!factor_and_solve(n, matrix, x, pool)) return false;
  return std::all_of(x.begin(), x.end(), [](double value) { return std::isfinite(value); });
}

}  // namespace sfmcpp::linear

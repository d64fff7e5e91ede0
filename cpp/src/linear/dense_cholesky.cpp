#include "sfmcpp/linear/dense_cholesky.hpp"

#include <cmath>

#ifdef SFMCPP_WITH_LAPACK
#include "sfmcpp/linear/blas_threads.hpp"

extern "C" {
void dpotrf_(const char* uplo, const int* n, double* a, const int* lda, int* info);
void dpotrs_(const char* uplo, const int* n, const int* nrhs, const double* a, const int* lda, double* b,
             const int* ldb, int* info);
}
#else
#include <Eigen/Cholesky>
#endif

namespace sfmcpp::linear {

bool dense_cholesky_solve(int n, double* matrix, std::span<double> x) {
  if (n == 0) return true;
#ifdef SFMCPP_WITH_LAPACK
  const SingleThreadedBlas single_threaded;
  const int one = 1;
  int info = 0;
  dpotrf_("L", &n, matrix, &n, &info);
  if (info != 0) return false;
  dpotrs_("L", &n, &one, matrix, &n, x.data(), &n, &info);
#else
  Eigen::Map<Eigen::MatrixXd> a(matrix, n, n);
  Eigen::LLT<Eigen::Ref<Eigen::MatrixXd>, Eigen::Lower> cholesky(a);
  if (cholesky.info() != Eigen::Success) return false;
  Eigen::Map<Eigen::VectorXd> b(x.data(), n);
  cholesky.solveInPlace(b);
#endif
  for (double value : x) {
    if (!std::isfinite(value)) return false;
  }
  return true;
}

}  // namespace sfmcpp::linear

#ifdef SFMCPP_WITH_CHOLMOD
#include <algorithm>
#include <cmath>
#include <new>

#include <cholmod.h>

#include "sfmcpp/linear/blas_threads.hpp"
#include "sfmcpp/linear/sparse_cholesky.hpp"

namespace sfmcpp::linear {
namespace {

class CholmodCholesky final : public SparseCholesky {
 public:
  explicit CholmodCholesky(const SparseLower& pattern) {
    cholmod_l_start(&common_);
    common_.print = 0;  // the core never prints
    common_.quick_return_if_not_posdef = 1;
    common_.final_ll =
        1;  // L Lᵀ also where it is not supernodal: L D Lᵀ would accept negative pivots
    common_.nmethods = 1;
    common_.method[0].ordering = CHOLMOD_NATURAL;
    common_.postorder = 1;
    cholmod_sparse view = view_of(pattern);
    const SingleThreadedBlas single_threaded;
    factor_ = cholmod_l_analyze(&view, &common_);
    if (factor_ == nullptr) {
      cholmod_l_finish(&common_);
      throw std::bad_alloc();
    }
  }
  ~CholmodCholesky() override {
    cholmod_l_free_factor(&factor_, &common_);
    cholmod_l_finish(&common_);
  }
  CholmodCholesky(const CholmodCholesky&) = delete;
  CholmodCholesky& operator=(const CholmodCholesky&) = delete;

  bool factorize(const SparseLower& matrix) override {
    cholmod_sparse view = view_of(matrix);
    const SingleThreadedBlas single_threaded;
    cholmod_l_factorize(&view, factor_, &common_);
    return common_.status == CHOLMOD_OK && factor_->minor == factor_->n;
  }

  void solve(std::vector<double>& x) override {
    cholmod_dense rhs{};
    rhs.nrow = rhs.d = rhs.nzmax = x.size();
    rhs.ncol = 1;
    rhs.x = x.data();
    rhs.xtype = CHOLMOD_REAL;
    rhs.dtype = CHOLMOD_DOUBLE;
    const SingleThreadedBlas single_threaded;
    cholmod_dense* solution = cholmod_l_solve(CHOLMOD_A, factor_, &rhs, &common_);
    if (solution == nullptr) throw std::bad_alloc();
    std::copy_n(static_cast<const double*>(solution->x), x.size(), x.begin());
    cholmod_l_free_dense(&solution, &common_);
  }

  double log_determinant() const override {
    const auto* values = static_cast<const double*>(factor_->x);
    double sum = 0.0;
    if (factor_->is_super == 0) {
      const auto* begin = static_cast<const SuiteSparse_long*>(factor_->p);
      for (std::size_t k = 0; k < factor_->n; ++k) sum += std::log(values[begin[k]]);
      return 2.0 * sum;
    }
    // Supernode s: columns first[s] to first[s + 1], stored full, with as many rows as it has
    // indices.
    const auto* first = static_cast<const SuiteSparse_long*>(factor_->super);
    const auto* rows = static_cast<const SuiteSparse_long*>(factor_->pi);
    const auto* entries = static_cast<const SuiteSparse_long*>(factor_->px);
    for (std::size_t s = 0; s < factor_->nsuper; ++s) {
      for (long k = 0; k < first[s + 1] - first[s]; ++k)
        sum += std::log(values[entries[s] + k * (rows[s + 1] - rows[s]) + k]);
    }
    return 2.0 * sum;
  }

 private:
  static cholmod_sparse view_of(const SparseLower& matrix) {
    cholmod_sparse view{};
    view.nrow = view.ncol = static_cast<std::size_t>(matrix.size);
    view.nzmax = matrix.row.size();
    // CHOLMOD reads these arrays only; its interface is not const.
    view.p = const_cast<std::int64_t*>(matrix.column_begin.data());
    view.i = const_cast<std::int64_t*>(matrix.row.data());
    view.x = const_cast<double*>(matrix.value.data());
    view.stype = -1;
    view.itype = CHOLMOD_LONG;
    view.xtype = CHOLMOD_REAL;
    view.dtype = CHOLMOD_DOUBLE;
    view.sorted = view.packed = 1;
    return view;
  }

  cholmod_common common_{};
  cholmod_factor* factor_ = nullptr;
};

}  // namespace

std::unique_ptr<SparseCholesky> make_sparse_cholesky(const SparseLower& pattern) {
  return std::make_unique<CholmodCholesky>(pattern);
}

std::string_view sparse_cholesky_name() { return "CHOLMOD"; }

}  // namespace sfmcpp::linear
#endif

#ifndef SFMCPP_WITH_CHOLMOD
#include <Eigen/SparseCholesky>

#include "sfmcpp/linear/sparse_cholesky.hpp"

namespace sfmcpp::linear {
namespace {

using Matrix = Eigen::SparseMatrix<double, Eigen::ColMajor, std::int64_t>;

class EigenCholesky final : public SparseCholesky {
 public:
  explicit EigenCholesky(const SparseLower& pattern) { cholesky_.analyzePattern(view_of(pattern)); }

  bool factorize(const SparseLower& matrix) override {
    cholesky_.factorize(view_of(matrix));
    return cholesky_.info() == Eigen::Success;
  }

  void solve(std::vector<double>& x) override {
    Eigen::Map<Eigen::VectorXd> b(x.data(), static_cast<Eigen::Index>(x.size()));
    b = cholesky_.solve(b).eval();
  }

  double log_determinant() const override {
    return 2.0 * cholesky_.matrixL().nestedExpression().diagonal().array().log().sum();
  }

 private:
  static Eigen::Map<const Matrix> view_of(const SparseLower& m) {
    return {m.size,
            m.size,
            static_cast<Eigen::Index>(m.row.size()),
            m.column_begin.data(),
            m.row.data(),
            m.value.data()};
  }

  Eigen::SimplicialLLT<Matrix, Eigen::Lower, Eigen::NaturalOrdering<std::int64_t>> cholesky_;
};

}  // namespace

std::unique_ptr<SparseCholesky> make_sparse_cholesky(const SparseLower& pattern) {
  return std::make_unique<EigenCholesky>(pattern);
}

std::string_view sparse_cholesky_name() { return "Eigen"; }

}  // namespace sfmcpp::linear
#endif

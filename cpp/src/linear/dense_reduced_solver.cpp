#include <algorithm>
#include <cmath>

#include "sfmcpp/linear/dense_cholesky.hpp"
#include "sfmcpp/linear/reduced_solver.hpp"

namespace sfmcpp::linear {
namespace {

class DenseReducedSolver final : public ReducedSolver {
 public:
  DenseReducedSolver(const CameraPattern& pattern, const ParameterMap& map, ThreadPool& pool)
      : pattern_(pattern), map_(map), pool_(pool), cholesky_(map.num_columns) {}

  void start(const std::vector<double>& diagonal) override {
    cholesky_.set_zero(pool_);
    for (int k = 0; k < cholesky_.size(); ++k) cholesky_.at(k, k) = diagonal[k];
  }

  void add_row(int i, const double* row_blocks) override {
    for_each_reduced_entry(
        pattern_, map_, i, row_blocks, [this](int row, int column, double value) {
          cholesky_.at(row, column) += value;
        });
  }

  bool factorize() override { return cholesky_.factorize(pool_); }

  bool solve(std::vector<double>& x) override {
    cholesky_.solve(x);
    return std::all_of(x.begin(), x.end(), [](double value) { return std::isfinite(value); });
  }

 private:
  const CameraPattern& pattern_;
  const ParameterMap& map_;
  ThreadPool& pool_;
  DenseCholesky cholesky_;
};

}  // namespace

std::unique_ptr<ReducedSolver> make_dense_reduced_solver(const CameraPattern& pattern,
                                                         const ParameterMap& map,
                                                         ThreadPool& pool) {
  return std::make_unique<DenseReducedSolver>(pattern, map, pool);
}

}  // namespace sfmcpp::linear

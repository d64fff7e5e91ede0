#include <algorithm>

#include "sfmcpp/linear/dense_cholesky.hpp"
#include "sfmcpp/linear/reduced_solver.hpp"

namespace sfmcpp::linear {
namespace {

class DenseReducedSolver final : public ReducedSolver {
 public:
  DenseReducedSolver(const CameraPattern& pattern, const ParameterMap& map, ThreadPool& pool)
      : pattern_(pattern),
        map_(map),
        pool_(pool),
        matrix_(static_cast<std::size_t>(size()) * size()) {}

  bool solve(const double* blocks,
             const std::vector<double>& diagonal,
             std::vector<double>& x) override {
    clear();
    assemble(blocks);
    for (int k = 0; k < size(); ++k) at(k, k) += diagonal[k];
    return dense_cholesky_solve(size(), matrix_.data(), x, pool_);
  }

 private:
  int size() const { return map_.num_columns; }
  double& at(int row, int column) {
    return matrix_[static_cast<std::size_t>(column) * size() + row];
  }

  void clear() {
    constexpr int kColumns = 64;
    pool_.parallel_for((size() + kColumns - 1) / kColumns, [this](int task) {
      const int end = std::min((task + 1) * kColumns, size());
      for (int c = task * kColumns; c < end; ++c)
        std::fill(&at(c, c), &at(c, c) + (size() - c), 0.0);
    });
  }

  void assemble(const double* blocks) {
    const auto add_row = [&](int i) {
      for_each_reduced_entry(pattern_, map_, i, blocks, [this](int row, int column, double value) {
        at(row, column) += value;
      });
    };
    if (map_.has_shared_columns) {  // rows add to common entries
      for (int i = 0; i < pattern_.num_rows(); ++i) add_row(i);
    } else {
      pool_.parallel_for(pattern_.num_rows(), add_row);
    }
  }

  const CameraPattern& pattern_;
  const ParameterMap& map_;
  ThreadPool& pool_;
  AlignedVector<double> matrix_;
};

}  // namespace

std::unique_ptr<ReducedSolver> make_dense_reduced_solver(const CameraPattern& pattern,
                                                         const ParameterMap& map,
                                                         ThreadPool& pool) {
  return std::make_unique<DenseReducedSolver>(pattern, map, pool);
}

}  // namespace sfmcpp::linear

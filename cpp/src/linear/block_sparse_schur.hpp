// The Schur complement in blocks: those above the diagonal in single precision, those on it in
// double precision.
#pragma once

#include <memory>
#include <vector>

#include "schur_operator.hpp"
#include "sfmcpp/linear/block_product_kernels.hpp"
#include "shared_schur_rows.hpp"

namespace sfmcpp::linear {

class BlockSparseSchur final : public SchurOperator {
 public:
  // The references must outlive this object. `structure` is of all ranks; each has the rows of its
  // own cameras.
  BlockSparseSchur(const NormalEquations& normal,
                   PointElimination& elimination,
                   const CameraShares& shares,
                   const std::shared_ptr<const ReducedStructure>& structure);

  // A row is formed in double precision and rounded when it is complete.
  void assemble(CameraBlockDiagonal& diagonal, std::vector<double>& rhs) override;
  void add_product(const std::vector<double>& x, std::vector<double>& out) override;
  bool is_rounded() const override { return true; }
  std::vector<char> touched_cameras() const override { return touched_; }

  const CameraPattern& pattern() const { return pattern_; }
  const BlockProductKernels& kernels() const { return kernels_; }
  // In panel layout; without B and λD.
  const double* diagonal_block(int i) const { return diagonal_ + area() * i; }
  // The blocks (i, j), j > i, of row i as the kernels want them.
  const float* blocks_of_row(int i) const {
    return blocks_.data() + area() * (pattern_.row_begin[i] - i);
  }
  std::span<const int> columns_of_row(int i) const {
    return {pattern_.column.data() + pattern_.row_begin[i] + 1,
            pattern_.column.data() + pattern_.row_begin[i + 1]};
  }

 private:
  // Rows of the upper half that one task multiplies, and the cameras that they reach.
  struct RowTask {
    int begin;
    int end;
    int reach;          // one behind the last camera
    std::size_t first;  // of its sums, those of camera `begin`, in numbers
  };
  long area() const {
    return static_cast<long>(normal_.map().camera_size) * normal_.map().camera_size;
  }
  std::vector<RowTask> cut_rows(long blocks_per_task) const;
  std::size_t numbers_of(const std::vector<RowTask>& tasks) const;
  std::vector<RowTask> choose_tasks() const;
  void form_row(int i, int worker, CameraBlockDiagonal& diagonal);
  void multiply_rows(const RowTask& task);
  void add_up(int begin, int end);

  const NormalEquations& normal_;
  SharedSchurRows schur_rows_;
  const CameraPattern& pattern_;
  std::vector<char> touched_;  // camera
  BlockProductKernels kernels_;
  std::vector<RowTask> tasks_;
  AlignedVector<float> blocks_;              // above the diagonal, row after row
  const double* diagonal_ = nullptr;         // of every camera
  AlignedVector<double> sums_;               // of the tasks
  AlignedVector<double> x_, out_;            // camera blocks
  std::vector<AlignedVector<double>> rows_;  // of each worker, the blocks of one row
};

}  // namespace sfmcpp::linear

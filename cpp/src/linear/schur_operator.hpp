// How the iterative solver multiplies with the Schur complement.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "distributed_schur_rows.hpp"
#include "rank_partition.hpp"
#include "sfmcpp/linear/block_diagonal.hpp"
#include "sfmcpp/linear/block_product_kernels.hpp"
#include "sfmcpp/linear/point_elimination.hpp"
#include "sfmcpp/linear/reduced_structure.hpp"
#include "sfmcpp/linear/sum_grid.hpp"

namespace sfmcpp::linear {

class SchurOperator {
 public:
  virtual ~SchurOperator() = default;
  // For the factors that the elimination of the points has now: the blocks of cameras and their
  // right-hand sides (CameraBlockDiagonal), and whatever the product needs.
  virtual void form(CameraBlockDiagonal& diagonal) = 0;
  // Then the diagonal blocks are gathered from them, as often as they are to be factored.
  virtual void gather(CameraBlockDiagonal& diagonal, std::vector<double>& rhs) const = 0;
  // out += Pᵀ S P x of what this rank has of S; neither B of camera_terms.hpp nor λD.
  virtual void add_product(const std::vector<double>& x, std::vector<double>& out) = 0;
  virtual void add_product(const std::vector<double>& x, std::vector<CompensatedSum>& out) = 0;
  // Whether the product reads or adds to columns of each camera.
  virtual std::vector<char> touched_cameras() const = 0;
  // Whether entries of S are rounded to single precision. Their sums are exact then; others have to
  // be compensated to have the same bits however points are divided among ranks.
  virtual bool is_rounded() const = 0;
};

// The references must outlive the operator.
std::unique_ptr<SchurOperator> make_implicit_schur(const NormalEquations& normal,
                                                   PointElimination& elimination);

// The Schur complement in blocks: those above the diagonal in single precision, those on it in
// double precision.
class BlockSparseSchur final : public SchurOperator {
 public:
  // The references must outlive this object. `structure` is of all ranks; each has the rows of its
  // own cameras.
  BlockSparseSchur(const NormalEquations& normal,
                   PointElimination& elimination,
                   const CameraPartition& partition,
                   const std::shared_ptr<const ReducedStructure>& structure);

  // A row is formed in double precision and rounded when it is complete.
  void form(CameraBlockDiagonal& diagonal) override;
  void gather(CameraBlockDiagonal& diagonal, std::vector<double>& rhs) const override;
  void add_product(const std::vector<double>& x, std::vector<double>& out) override {
    multiply(x, out);
  }
  void add_product(const std::vector<double>& x, std::vector<CompensatedSum>& out) override {
    multiply(x, out);
  }
  bool is_rounded() const override { return true; }
  std::vector<char> touched_cameras() const override { return touched_; }

  // In panel layout; without B and λD.
  const double* diagonal_block(int i) const { return diagonal_ + area() * i; }
  // The blocks (i, j), j > i, of row i as the kernels want them, divided by the powers of two of
  // their rows and columns.
  const float* blocks_of_row(int i) const { return blocks_.data() + first_of_row(i); }
  const double* powers(int i) const { return schur_rows_.grid().of_camera(i); }
  std::span<const int> columns_behind(int i) const { return pattern_.columns_behind(i); }

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
  // Of the blocks above the diagonal, as every row before has one on it.
  long first_of_row(int i) const { return area() * (pattern_.row_begin[i] - i); }
  std::vector<RowTask> cut_rows(long blocks_per_task) const;
  std::size_t numbers_of(const std::vector<RowTask>& tasks) const;
  std::vector<RowTask> choose_tasks() const;
  void form_rows(std::span<const int> cameras, int worker, CameraBlockDiagonal& diagonal);
  void round_row(int i, const double* row);
  template <class Number>
  void multiply(const std::vector<double>& x, std::vector<Number>& out);
  void multiply_rows(const RowTask& task);
  void expand(const std::vector<double>& x);
  double largest_of_x() const;
  void add_up(int begin, int end);
  void finish_camera(int i);

  const NormalEquations& normal_;
  DistributedSchurRows schur_rows_;
  const CameraPattern& pattern_;
  std::vector<char> touched_;  // camera
  BlockProductKernels kernels_;
  std::vector<RowTask> tasks_;
  AlignedVector<float> blocks_;              // above the diagonal, row after row
  const double* diagonal_ = nullptr;         // of every camera
  int most_terms_;                           // blocks that add to a camera, at most
  double middle_ = 0.0;                      // of the sums of this product
  AlignedVector<double> sums_;               // of the tasks
  AlignedVector<double> x_, out_;            // camera blocks, times powers and divided by them
  std::vector<AlignedVector<double>> rows_;  // of each worker, the blocks of a few rows
};

// (S + B + λD) x for vectors that are distributed over ranks: each multiplies by its part of S, and
// what that adds to columns of other ranks is sent to them.
class DistributedProduct {
 public:
  // The references must outlive this object. By all ranks, as is `apply`.
  DistributedProduct(const NormalEquations& normal,
                     SchurOperator& schur,
                     const CameraPartition& partition);

  SchurOperator& schur() { return schur_; }
  const ColumnPartition& columns() const { return columns_; }
  // With λD in `diagonal`; all three of own columns.
  void apply(const Vector& diagonal, const Vector& x, Vector& out);

 private:
  template <class Number>
  void multiply(const Vector& x, std::vector<Number>& whole, Vector& out);

  const NormalEquations& normal_;
  SchurOperator& schur_;
  std::vector<char> is_own_;  // camera
  ColumnPartition columns_;
  // Products with all columns: where sums are exact, and where they are not.
  Vector whole_;
  std::vector<CompensatedSum> whole_sums_;
};

}  // namespace sfmcpp::linear

// Direct solution of the reduced camera system (Pᵀ S P + diag) x = rhs, with S given by camera
// blocks.
#pragma once

#include <compare>
#include <memory>
#include <span>
#include <vector>

#include <Eigen/Core>
#include <Eigen/SparseCore>

#include "sfmcpp/core/exchange.hpp"
#include "sfmcpp/core/parallel.hpp"
#include "sfmcpp/linear/block_layout.hpp"
#include "sfmcpp/linear/reduced_structure.hpp"

namespace sfmcpp::linear {

// The matrix is handed over row by row: start, add_row for every camera, then factorize once and
// solve for any right-hand side.
class ReducedSolver {
 public:
  ReducedSolver(const CameraPattern& pattern, const ParameterMap& map);
  virtual ~ReducedSolver() = default;

  // Sets the matrix to diag.
  virtual void start(const std::vector<double>& diagonal) = 0;
  // Adds what the blocks of camera row i (panel layout) have in columns of one camera alone, or in
  // shared ones. The former may be added for several cameras at the same time; of the latter the
  // order of the calls is the order of the sums.
  void add_row(int i, const double* row_blocks, Columns columns);
  // The sum of the matrices of all ranks, on each. What S is zero in is not sent.
  void sum_over(Exchange& ranks);
  // False if the matrix is not positive definite.
  virtual bool factorize() = 0;
  // `x` holds the right-hand side before and the solution after; false if that is not finite.
  bool solve(std::vector<double>& x);
  // The same for the poses, with the intrinsics left as they are. Only where the matrix has the
  // poses first: of its factor the first part is theirs.
  virtual bool has_poses_first() const { return false; }
  virtual bool solve_poses(std::vector<double>& /*x*/) { return false; }
  // The same for every column of `x`, which need not come out finite.
  virtual void solve_columns(Eigen::MatrixXd& x) = 0;
  // xᵀ A⁻¹ x of the factorised matrix A, for several threads at once, each by its number.
  virtual Eigen::MatrixXd inverse_product(const Eigen::SparseMatrix<double>& x, int worker) = 0;
  virtual double log_determinant() const = 0;

 protected:
  const ParameterMap& map() const { return map_; }
  // Where rows set the matrix, with the diagonal of `start`, instead of adding to it; else null.
  virtual const double* diagonal_to_set() const { return nullptr; }
  // What lies above the diagonal is never read.
  virtual std::span<double> values() = 0;
  // Variable blocks by their place in the order of the matrix; row_block ≥ column_block.
  virtual int position(int block) const = 0;
  virtual BlockPlace place(int row_block, int column_block) const = 0;
  virtual void solve_in_place(std::vector<double>& x) = 0;

 private:
  // Consecutive columns of a camera block that are consecutive in one variable block.
  struct Segment {
    int first;   // in the camera block
    int length;  // columns
    int block;   // variable block
    int offset;  // of the first column in the variable block
    bool shared;
  };

  std::span<const Segment> segments_of(int camera) const {
    return {segments_.data() + segment_begin_[camera],
            segments_.data() + segment_begin_[camera + 1]};
  }
  void add_segments(int camera, const std::vector<char>& shared);
  struct Adds;
  struct Sets;
  void set_row(int i, const double* row_blocks, const double* diagonal);
  template <class Put>
  void put_pair(const Segment& rows,
                const Segment& columns,
                bool diagonal,
                const double* block,
                const Put& put);
  template <class Put>
  void put_within(const Segment& rows,
                  const Segment& columns,
                  bool diagonal,
                  const double* block,
                  const Put& put);

  // Variable blocks that S couples; the row comes later in the order of the matrix, or is the same.
  struct Couple {
    int row, column;
    auto operator<=>(const Couple&) const = default;
  };
  std::vector<Couple> find_couples() const;
  template <class F>
  void for_each_value(Couple couple, const F& f);

  const CameraPattern& pattern_;
  const ParameterMap& map_;
  std::vector<Segment> segments_;
  std::vector<std::size_t> segment_begin_;  // of each camera
  std::vector<Couple> couples_;             // on several ranks, once they have summed
};

// The references must outlive the solver.
std::unique_ptr<ReducedSolver> make_dense_reduced_solver(const ReducedStructure& structure,
                                                         const ParameterMap& map,
                                                         ThreadPool& pool);
std::unique_ptr<ReducedSolver> make_sparse_reduced_solver(const ReducedStructure& structure,
                                                          const ParameterMap& map,
                                                          ThreadPool& pool);

}  // namespace sfmcpp::linear

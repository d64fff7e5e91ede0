// Cholesky factorisation of a sparse matrix of blocks by supernodes (supernodes.hpp), in place.
//
// Right-looking: the update of a supernode to its ancestors is computed tile by tile, in the cache,
// and added to their panels. Disjoint subtrees are parallel tasks; each gathers its updates to
// supernodes outside the subtree in a triangle of its own, since two tasks may not write to one
// panel. Then the supernodes above the subtrees follow one after the other, each with all threads.
// Every entry is summed in one fixed order: the bits do not depend on the number of threads.
#pragma once

#include <span>
#include <vector>

#include <Eigen/Core>

#include "sfmcpp/core/aligned.hpp"
#include "sfmcpp/core/parallel.hpp"
#include "sfmcpp/linear/block_layout.hpp"
#include "sfmcpp/linear/cholesky_kernels.hpp"
#include "sfmcpp/linear/panel_cholesky.hpp"
#include "sfmcpp/linear/supernodes.hpp"

namespace sfmcpp::linear {

// The updates of several subtrees to the supernodes above, the lower triangle of a square matrix:
// columns in groups of kStrip that begin with the strip of their diagonal.
class UpdateTriangle {
 public:
  UpdateTriangle() = default;
  explicit UpdateTriangle(int size);

  std::int64_t num_entries() const { return num_entries_; }
  // Where row 0 of a column would be: row r is `r` further. Rows above the strip of the diagonal
  // are not stored.
  std::int64_t column(int c) const {
    const std::int64_t group = c / kStrip;
    return kStrip * (group * padded_ - kStrip * group * (group - 1) / 2) +
           (c - kStrip * group) * (padded_ - kStrip * group) - kStrip * group;
  }

 private:
  int padded_ = 0;
  std::int64_t num_entries_ = 0;
};

inline constexpr int kOutside = -1;

// The columns [begin, end) of an update belong to one supernode; the runs give the place of the
// update's rows, from `begin` on, among the rows of its panel (the first of these are its columns).
struct UpdateTarget {
  int supernode;  // or kOutside: the triangle of the subtrees
  int begin;
  int end;
  int first_run;
  int num_runs;
};

// Where the rows below a supernode lie in the panels of the supernodes above.
struct UpdateMap {
  std::vector<UpdateTarget> targets;
  std::vector<RowRun> runs;

  void clear() {
    targets.clear();
    runs.clear();
  }
};

// `rows`: places, `offsets`: their first rows in an update of `height` rows. What lies above
// `subtrees` goes to their triangle; null: there is none.
void make_update_map(const Supernodes& supernodes,
                     std::span<const int> rows,
                     std::span<const int> offsets,
                     int height,
                     const Subtrees* subtrees,
                     UpdateMap& map);

class SupernodalCholesky {
 public:
  // The supernodes must outlive it.
  explicit SupernodalCholesky(const Supernodes& supernodes,
                              const CholeskyKernels& kernels = cholesky_kernels());

  // Blocks by their place in the order of elimination, row_block ≥ column_block; Error if the two
  // are not coupled. Above the diagonal nothing is read.
  BlockPlace place(int row_block, int column_block) const;
  std::span<double> values() { return values_; }

  void set_zero(ThreadPool& pool);
  // False if the matrix is not positive definite.
  bool factorize(ThreadPool& pool);
  // x ← A⁻¹ x, in the order of elimination.
  void solve(std::span<double> x, ThreadPool& pool);
  // The same for every column.
  void solve(Eigen::MatrixXd& x, ThreadPool& pool) const;

  // Of one thread, for products with the inverse; zero between two of them.
  struct HalfSolution {
    Eigen::MatrixXd values;     // in the order of elimination
    std::vector<char> reached;  // supernodes
    Eigen::MatrixXd panel;
  };
  // xᵀ A⁻¹ x = BᵀB with B = L⁻¹ x, in the order of elimination, by one thread. Only the supernodes
  // from the entries of x to the root take part.
  Eigen::MatrixXd inverse_product(const SparseEntries& x, int columns, HalfSolution& work) const;
  double log_determinant() const;

 private:
  // Of one thread: the update that is under way, and rows of a right-hand side.
  struct Work {
    UpdateMap map;
    UpdateTriangle outside;  // shape of the triangle
    int height = 0;
    std::vector<ProductTile> tiles;
    std::vector<double> rows;
  };

  double* panel(int s) { return values_.data() + s_.panel[s].first; }
  const double* panel(int s) const { return values_.data() + s_.panel[s].first; }
  void prepare(int threads);
  bool factor_subtrees(std::size_t part, int worker, const ThreadPool& pool);
  bool factor_top(int supernode, ThreadPool& pool);
  void add_triangles(int supernode, ThreadPool& pool);
  void update_above(
      int supernode, const Subtrees* part, double* triangle, ThreadPool* pool, int worker);
  void add_tile(const Work& plan, const ProductTile& tile, const double* product, double* triangle);

  // The updates of subtrees to the right-hand side of the supernodes above them.
  struct Outside {
    const Subtrees* part;
    std::vector<double> taken;
  };
  void forward(int supernode, double* x, Outside* outside, std::vector<double>& y) const;
  void backward(int supernode, double* x, std::vector<double>& y) const;
  void forward(int supernode, HalfSolution& work, int columns) const;

  const Supernodes& s_;
  CholeskyKernels kernels_;
  AlignedVector<double> values_;
  std::vector<std::int64_t> in_order_;            // 0, 1, 2, … for the rows of a block
  std::vector<AlignedVector<double>> triangles_;  // of each set of subtrees
  std::vector<UpdateMap> triangle_maps_;
  std::vector<ProductScratch> scratch_;  // of each thread
  std::vector<Work> work_;
  std::vector<Outside> outside_;  // of each set of subtrees
  std::vector<char> failed_;      // of each set of subtrees
};

}  // namespace sfmcpp::linear

// Cholesky factorisation of a sparse matrix of blocks by supernodes (supernodes.hpp), in place.
//
// Right-looking: what a supernode takes from those above is computed tile by tile, in the cache,
// and added to their panels. Disjoint subtrees are tasks; what they take from the supernodes above
// them is gathered in a triangle for each, since two may not write to one panel. Then the
// supernodes above follow one after the other, each with all threads. Every entry is summed in one
// fixed order: the bits do not depend on the number of threads.
#pragma once

#include <span>
#include <vector>

#include <Eigen/Core>

#include "sfmcpp/core/aligned.hpp"
#include "sfmcpp/core/parallel.hpp"
#include "sfmcpp/linear/block_place.hpp"
#include "sfmcpp/linear/cholesky_kernels.hpp"
#include "sfmcpp/linear/panel_products.hpp"
#include "sfmcpp/linear/supernodal_updates.hpp"
#include "sfmcpp/linear/supernodes.hpp"

namespace sfmcpp::linear {

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
  void solve(std::span<double> x, ThreadPool& pool) const;
  // The same for every column.
  void solve(Eigen::MatrixXd& x, ThreadPool& pool) const;
  double log_determinant() const;

 private:
  // Of one thread: the update that is under way.
  struct Work {
    UpdateMap map;
    UpdateTriangle outside;  // shape of the triangle
    int height = 0;
    std::vector<ProductTile> tiles;
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

  // What subtrees take from the right-hand side of the supernodes above them.
  struct Outside {
    const Subtrees* part;
    std::vector<double> taken;
  };
  void forward(int supernode, double* x, Outside* outside, std::vector<double>& y) const;
  void backward(int supernode, double* x, std::vector<double>& y) const;

  const Supernodes& s_;
  CholeskyKernels kernels_;
  AlignedVector<double> values_;
  std::vector<AlignedVector<double>> triangles_;  // of each set of subtrees
  std::vector<UpdateMap> triangle_maps_;
  std::vector<ProductScratch> scratch_;  // of each thread
  std::vector<Work> work_;
};

}  // namespace sfmcpp::linear

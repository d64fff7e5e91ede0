// Cholesky factorisation of panels: columns of a lower triangle with all the rows below,
// column-major, as a supernode (supernodes.hpp) is one. Rows come in strips of kStrip, columns in
// multiples of kPanel (cholesky_kernels.hpp).
#pragma once

#include <vector>

#include <Eigen/Core>
#include <Eigen/SparseCore>

#include "sfmcpp/core/aligned.hpp"
#include "sfmcpp/core/parallel.hpp"
#include "sfmcpp/linear/cholesky_kernels.hpp"

namespace sfmcpp::linear {

// Entries of sparse right-hand sides.
using SparseEntries = std::vector<Eigen::Triplet<double>>;

template <class Integer>
constexpr Integer round_up(Integer n, int multiple) {
  return (n + multiple - 1) / multiple * multiple;
}

// Calls f(task, worker) for every task: by a pool, or one after the other where that is null.
template <class F>
void for_each_task(ThreadPool* pool, int count, const F& f) {
  if (pool != nullptr) {
    pool->parallel_for_worker(count, f);
  } else {
    for (int task = 0; task < count; ++task) f(task, 0);
  }
}

// A part of L Lᵀ, for rows and columns from a range of the rows of L.
struct ProductTile {
  int row_begin, row_end;        // whole strips
  int column_begin, column_end;  // from the first row of a strip; a multiple of kPanel
};

inline constexpr int kTileRows = 256;
inline constexpr int kTileColumns = 128;

// Rows of the tiles of so many, kTileRows at most: a few tiles for each thread. They are
// independent of one another, so the bits do not depend on it.
int rows_of_tile(int rows, const ThreadPool* pool);

// Work space of one thread: the factors of a product, packed for the kernels, and the product.
struct ProductScratch {
  AlignedVector<double> rows;
  AlignedVector<double> columns;
  AlignedVector<double> product;

  ProductScratch();
};

// c −= the tile of l lᵀ, l of `inner` columns; c has the tile's first entry. Entries above the
// diagonal of l lᵀ may be overwritten with unspecified values.
void subtract_product(const CholeskyKernels& kernels,
                      const double* l,
                      long ld,
                      int inner,
                      const ProductTile& tile,
                      double* c,
                      long c_stride,
                      ProductScratch& scratch);

// The Cholesky factor in place of the first `columns` of `rows` rows. False: not positive definite.
// Left-looking by tiles of columns; the strips of a tile are independent tasks, so the bits do not
// depend on the number of threads. `scratch`: one for each worker of the pool.
bool factor_panel(const CholeskyKernels& kernels,
                  double* panel,
                  long ld,
                  int columns,
                  int rows,
                  ThreadPool* pool,
                  ProductScratch* scratch);

// The forward solve of the kernels for every column of x (rows by columns, column-major without
// gaps): parts of l that the cache holds meet them all. With the bits of one column by itself.
void forward_columns(const CholeskyKernels& kernels,
                     const double* l,
                     long ld,
                     int columns,
                     Eigen::Ref<Eigen::MatrixXd> x);

}  // namespace sfmcpp::linear

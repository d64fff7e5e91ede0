#include "sfmcpp/linear/panel_cholesky.hpp"

#include <algorithm>

namespace sfmcpp::linear {
namespace {

constexpr int kInner = 128;   // columns of both factors that are packed at a time
constexpr int kWide = 128;    // columns of a panel that are factored before the others are updated
constexpr int kLarge = 1024;  // rows from which on tasks are several strips
constexpr int kInnerBlock = 256;     // columns of b that stay in the cache
constexpr int kColumnsInCache = 32;  // of a factor, which several right-hand sides meet

// Columns of one panel that are factored together, by tiles.
class NarrowPanel {
 public:
  NarrowPanel(const CholeskyKernels& kernels,
              double* panel,
              long ld,
              int columns,
              int rows,
              ThreadPool* pool)
      : kernels_(kernels),
        panel_(panel),
        ld_(ld),
        columns_(columns),
        rows_(rows),
        tile_(rows < kLarge ? 32 : 64),
        rows_per_task_(rows < kLarge ? kStrip : 4 * kStrip),
        pool_(pool) {}

  bool factor() {
    for (int column = 0; column < columns_; column += tile_) {
      const int width = std::min(tile_, columns_ - column);
      for_rows_from(column, [&](int begin, int end) { update(begin, end, column, width); });
      if (!kernels_.factor(at(column, column), ld_, width)) return false;
      for_rows_from(round_up(column + width, kStrip),
                    [&](int begin, int end) { solve(begin, end, column, width); });
    }
    return true;
  }

 private:
  double* at(int row, int column) const { return panel_ + column * ld_ + row; }

  // f(begin, end) for the rows from `first` on, in parallel.
  template <class F>
  void for_rows_from(int first, const F& f) {
    for_each_task(pool_, (rows_ - first + rows_per_task_ - 1) / rows_per_task_, [&](int task, int) {
      const int begin = first + task * rows_per_task_;
      f(begin, std::min(begin + rows_per_task_, rows_));
    });
  }

  void update(int begin, int end, int column, int width) const {
    for (int inner = 0; inner < column; inner += kInnerBlock) {
      const int count = std::min(kInnerBlock, column - inner);
      for (int row = begin; row < end; row += kStrip)
        kernels_.update(at(row, inner), at(column, inner), at(row, column), ld_, count, width);
    }
  }

  void solve(int begin, int end, int column, int width) const {
    for (int row = begin; row < end; row += kStrip)
      kernels_.solve_strip(at(column, column), at(row, column), ld_, width);
  }

  const CholeskyKernels& kernels_;
  double* panel_;
  long ld_;
  int columns_;
  int rows_;
  int tile_;  // columns factored at a time
  int rows_per_task_;
  ThreadPool* pool_;
};

}  // namespace

// Each task packs the columns anew, so it has two strips at least.
int rows_of_tile(int rows, const ThreadPool* pool) {
  constexpr int kTasksPerThread = 4, kFewestRows = 2 * kStrip;
  if (pool == nullptr || pool->num_threads() == 1) return kTileRows;
  const int tasks = kTasksPerThread * pool->num_threads();
  return std::clamp(round_up(rows / tasks, kStrip), kFewestRows, kTileRows);
}

ProductScratch::ProductScratch()
    : rows(static_cast<std::size_t>(kTileRows) * kInner),
      columns(static_cast<std::size_t>(kWide) * kInner),
      product(static_cast<std::size_t>(kTileRows + kPanel) * kTileColumns) {}

void subtract_product(const CholeskyKernels& kernels,
                      const double* l,
                      long ld,
                      int inner,
                      const ProductTile& tile,
                      double* c,
                      long c_stride,
                      ProductScratch& scratch) {
  const int first = std::max(tile.row_begin, tile.column_begin);
  for (int k = 0; k < inner; k += kInner) {
    const int count = std::min(kInner, inner - k);
    const double* part = l + k * ld;
    kernels.pack(part + first, ld, tile.row_end - first, count, scratch.rows.data());
    kernels.pack(part + tile.column_begin,
                 ld,
                 round_up(tile.column_end - tile.column_begin, kStrip),
                 count,
                 scratch.columns.data());
    for (int row = first; row < tile.row_end; row += kStrip) {
      const int columns = std::min(tile.column_end, row + kStrip) - tile.column_begin;
      kernels.update_packed(scratch.rows.data() + static_cast<long>(row - first) * count,
                            scratch.columns.data(),
                            c + (row - tile.row_begin),
                            c_stride,
                            count,
                            columns);
    }
  }
}

bool factor_panel(const CholeskyKernels& kernels,
                  double* panel,
                  long ld,
                  int columns,
                  int rows,
                  ThreadPool* pool,
                  ProductScratch* scratch) {
  const int wide = columns < 2 * kWide ? columns : kWide;
  for (int begin = 0; begin < columns; begin += wide) {
    const int end = std::min(begin + wide, columns);
    const int height = rows_of_tile(rows - begin, pool);
    const int tasks = begin == 0 ? 0 : ThreadPool::num_parts(rows - begin, height);
    for_each_task(pool, tasks, [&](int task, int worker) {
      const int row = begin + task * height;
      subtract_product(kernels,
                       panel,
                       ld,
                       begin,
                       {row, std::min(row + height, rows), begin, end},
                       panel + begin * ld + row,
                       ld,
                       scratch[worker]);
    });
    if (!NarrowPanel(kernels, panel + begin * ld + begin, ld, end - begin, rows - begin, pool)
             .factor())
      return false;
  }
  return true;
}

void forward_columns(const CholeskyKernels& kernels,
                     const double* l,
                     long ld,
                     int columns,
                     Eigen::Ref<Eigen::MatrixXd> x) {
  const auto rows = static_cast<int>(x.rows());
  for (int first = 0; first < columns; first += kColumnsInCache) {
    const int last = std::min(first + kColumnsInCache, columns);
    for (Eigen::Index c = 0; c < x.cols(); ++c) {
      // Zeros come first in what is sparse.
      if (x.col(c).segment(first, last - first).isZero(0.0)) continue;
      kernels.forward(
          l + first * (ld + 1), ld, last - first, rows - first, x.col(c).data() + first);
    }
  }
}

}  // namespace sfmcpp::linear

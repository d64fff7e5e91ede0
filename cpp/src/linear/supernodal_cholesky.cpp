#include "sfmcpp/linear/supernodal_cholesky.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "sfmcpp/core/error.hpp"

namespace sfmcpp::linear {
namespace {

constexpr long kEntriesPerTask = 1L << 16;     // set to zero
constexpr int kSupernodalColumnsPerTask = 32;  // that get what subtrees take from them
constexpr int kProductStride = kTileRows + kPanel;

// Tiles of the lower triangle of an update.
void cut_tiles(int padded_height, const ThreadPool* pool, std::vector<ProductTile>& tiles) {
  tiles.clear();
  const int height = rows_of_tile(padded_height, pool);
  for (int column = 0; column < padded_height; column += kTileColumns) {
    const int end = std::min(column + kTileColumns, padded_height);
    for (int row = column; row < padded_height; row += height)
      tiles.push_back({row, std::min(row + height, padded_height), column, end});
  }
}

// Adds columns of an update to the panel of a target. `source(q)` and `target(c)` point to row 0 of
// column q of the update and of column c of the target; rows from [row_begin, row_end).
template <class Source, class Target>
void add_columns(const CholeskyKernels& kernels,
                 const RowRun* runs,
                 int column_begin,
                 int column_end,
                 int row_begin,
                 int row_end,
                 const Source& source,
                 const Target& target) {
  const RowRun* column_run = runs;
  const RowRun* row_run = runs;
  for (int q = column_begin; q < column_end; ++q) {
    const int first = std::max(q, row_begin);
    if (first >= row_end) return;
    while (column_run->source + column_run->length <= q) ++column_run;
    while (row_run->source + row_run->length <= first) ++row_run;
    kernels.add_runs(
        source(q), target(column_run->target + q - column_run->source), row_run, first, row_end);
  }
}

}  // namespace

SupernodalCholesky::SupernodalCholesky(const Supernodes& supernodes, const CholeskyKernels& kernels)
    : s_(supernodes),
      kernels_(kernels),
      values_(static_cast<std::size_t>(supernodes.num_entries)),
      triangles_(supernodes.subtrees.size()),
      triangle_maps_(supernodes.subtrees.size()) {
  int largest = 0;
  for (std::size_t k = 1; k < s_.first_column.size(); ++k)
    largest = std::max(largest, s_.first_column[k] - s_.first_column[k - 1]);
  in_order_.resize(static_cast<std::size_t>(largest));
  std::iota(in_order_.begin(), in_order_.end(), 0);
  for (std::size_t k = 0; k < triangles_.size(); ++k) {
    const Subtrees& part = s_.subtrees[k];
    triangles_[k].resize(static_cast<std::size_t>(UpdateTriangle(part.height).num_entries()));
    outside_.push_back({&part, std::vector<double>(static_cast<std::size_t>(part.height))});
    make_update_map(s_, part.rows, part.row_offset, part.height, nullptr, triangle_maps_[k]);
  }
}

BlockPlace SupernodalCholesky::place(int row_block, int column_block) const {
  const int s = s_.of_place[column_block];
  const SupernodePanel& panel = s_.panel[s];
  const int column = s_.first_column[column_block] - s_.columns_begin(s);
  std::int64_t row = s_.first_column[row_block] - s_.columns_begin(s);
  if (row_block >= s_.begin[s + 1]) {
    const std::span<const int> rows = s_.rows_of(s);
    const auto found = std::lower_bound(rows.begin(), rows.end(), row_block);
    if (found == rows.end() || *found != row_block)
      throw Error("a block of the reduced system lies outside its analysed pattern");
    row = panel.top + s_.offsets_of(s)[found - rows.begin()];
  }
  return {.first = panel.first + column * panel.stride + row,
          .stride = panel.stride,
          .rows = in_order_.data()};
}

void SupernodalCholesky::set_zero(ThreadPool& pool) {
  pool.parallel_for_parts(s_.num_entries, kEntriesPerTask, [this](long begin, long end) {
    std::fill(values_.data() + begin, values_.data() + end, 0.0);
  });
  for (int s = 0; s < s_.count(); ++s) {
    const SupernodePanel& shape = s_.panel[s];
    for (int c = shape.columns; c < shape.stored_columns; ++c)
      panel(s)[c * (shape.stride + 1)] = 1.0;
  }
}

void SupernodalCholesky::prepare(int threads) {
  scratch_.resize(threads);
  work_.resize(threads);
  failed_.assign(s_.subtrees.size(), 0);
}

bool SupernodalCholesky::factorize(ThreadPool& pool) {
  prepare(pool.num_threads());
  pool.parallel_for_worker(static_cast<int>(failed_.size()), [&](int part, int worker) {
    failed_[part] = !factor_subtrees(part, worker, pool);
  });
  if (std::ranges::count(failed_, 1) > 0) return false;
  return std::ranges::all_of(s_.top, [&](int s) { return factor_top(s, pool); });
}

bool SupernodalCholesky::factor_subtrees(std::size_t k, int worker, const ThreadPool& pool) {
  const Subtrees& part = s_.subtrees[k];
  std::ranges::fill(triangles_[k], 0.0);
  work_[worker].outside = UpdateTriangle(part.height);
  for (int s = part.first; s <= part.last; ++s) {
    const SupernodePanel& shape = s_.panel[s];
    if (!factor_panel(kernels_,
                      panel(s),
                      shape.stride,
                      shape.stored_columns,
                      static_cast<int>(shape.rows),
                      nullptr,
                      &scratch_[worker]))
      return false;
    update_above(s, &part, triangles_[k].data(), nullptr, worker);
    pool.heed_stop(worker);
  }
  return true;
}

bool SupernodalCholesky::factor_top(int s, ThreadPool& pool) {
  const SupernodePanel& shape = s_.panel[s];
  add_triangles(s, pool);
  if (!factor_panel(kernels_,
                    panel(s),
                    shape.stride,
                    shape.stored_columns,
                    static_cast<int>(shape.rows),
                    &pool,
                    scratch_.data()))
    return false;
  update_above(s, nullptr, nullptr, &pool, 0);
  return true;
}

// Subtree after subtree, in fixed order, for some columns of the panel.
void SupernodalCholesky::add_triangles(int s, ThreadPool& pool) {
  const SupernodePanel& shape = s_.panel[s];
  pool.parallel_for_parts(shape.columns, kSupernodalColumnsPerTask, [&](long begin, long end) {
    for (std::size_t k = 0; k < triangles_.size(); ++k) {
      const UpdateMap& map = triangle_maps_[k];
      const auto found = std::ranges::lower_bound(map.targets, s, {}, &UpdateTarget::supernode);
      if (found == map.targets.end() || found->supernode != s) continue;
      const UpdateTriangle triangle(s_.subtrees[k].height);
      const RowRun* runs = map.runs.data() + found->first_run;
      for (const RowRun* run = runs; run < runs + found->num_runs && run->source < found->end;
           ++run) {
        const long first = std::max<long>(run->target, begin),
                   last = std::min<long>(
                       {run->target + run->length, end, run->target + found->end - run->source});
        if (first >= last) continue;
        add_columns(
            kernels_,
            run,
            static_cast<int>(run->source + first - run->target),
            static_cast<int>(run->source + last - run->target),
            0,
            s_.subtrees[k].height,
            [&](int q) { return triangles_[k].data() + triangle.column(q); },
            [&](int c) { return panel(s) + c * shape.stride; });
      }
    }
  });
}

void SupernodalCholesky::update_above(
    int s, const Subtrees* part, double* triangle, ThreadPool* pool, int worker) {
  const SupernodePanel& shape = s_.panel[s];
  if (shape.height == 0) return;
  Work& work = work_[worker];
  make_update_map(s_, s_.rows_of(s), s_.offsets_of(s), shape.height, part, work.map);
  work.height = shape.height;
  cut_tiles(static_cast<int>(shape.rows) - shape.top, pool, work.tiles);
  ProductScratch* scratch = pool == nullptr ? &scratch_[worker] : scratch_.data();
  for_each_task(pool, static_cast<int>(work.tiles.size()), [&](int task, int thread) {
    const ProductTile& tile = work.tiles[task];
    double* product = scratch[thread].product.data();
    for (int c = 0; c < tile.column_end - tile.column_begin; ++c)
      std::fill_n(product + c * kProductStride, tile.row_end - tile.row_begin, 0.0);
    subtract_product(kernels_,
                     panel(s) + shape.top,
                     shape.stride,
                     shape.columns,
                     tile,
                     product,
                     kProductStride,
                     scratch[thread]);
    add_tile(work, tile, product, triangle);
  });
}

void SupernodalCholesky::add_tile(const Work& plan,
                                  const ProductTile& tile,
                                  const double* product,
                                  double* triangle) {
  const auto& targets = plan.map.targets;
  auto target = std::ranges::upper_bound(targets, tile.column_begin, {}, &UpdateTarget::end);
  for (; target != targets.end() && target->begin < tile.column_end; ++target) {
    const auto source = [&](int q) {
      return product + (q - tile.column_begin) * kProductStride - tile.row_begin;
    };
    const auto add = [&](const auto& column) {
      add_columns(kernels_,
                  plan.map.runs.data() + target->first_run,
                  std::max(target->begin, tile.column_begin),
                  std::min(target->end, tile.column_end),
                  tile.row_begin,
                  std::min(tile.row_end, plan.height),
                  source,
                  column);
    };
    if (target->supernode == kOutside) {
      add([&](int c) { return triangle + plan.outside.column(c); });
    } else {
      double* to = panel(target->supernode);
      const std::int64_t stride = s_.panel[target->supernode].stride;
      add([&](int c) { return to + c * stride; });
    }
  }
}

// x ← L⁻¹ x for the columns of one supernode, whose updates are added to its rows below.
void SupernodalCholesky::forward(int s, double* x, Outside* outside, std::vector<double>& y) const {
  const SupernodePanel& shape = s_.panel[s];
  double* own = x + s_.columns_begin(s);
  y.assign(static_cast<std::size_t>(shape.rows), 0.0);
  std::copy_n(own, shape.columns, y.begin());
  kernels_.forward(panel(s), shape.stride, shape.columns, static_cast<int>(shape.rows), y.data());
  std::copy_n(y.begin(), shape.columns, own);
  const std::span<const int> rows = s_.rows_of(s), offsets = s_.offsets_of(s);
  std::size_t above = 0;
  for (std::size_t k = 0; k < rows.size(); ++k) {
    const int first = s_.first_column[rows[k]], size = s_.first_column[rows[k] + 1] - first;
    double* to = x + first;
    if (outside != nullptr && s_.of_place[rows[k]] > outside->part->last) {
      while (outside->part->rows[above] < rows[k]) ++above;
      to = outside->taken.data() + outside->part->row_offset[above];
    }
    const double* from = y.data() + shape.top + offsets[k];
    for (int r = 0; r < size; ++r) to[r] += from[r];
  }
}

// x ← L⁻ᵀ x for the columns of one supernode, given its rows below.
void SupernodalCholesky::backward(int s, double* x, std::vector<double>& y) const {
  const SupernodePanel& shape = s_.panel[s];
  double* own = x + s_.columns_begin(s);
  y.assign(static_cast<std::size_t>(shape.rows), 0.0);
  std::copy_n(own, shape.columns, y.begin());
  const std::span<const int> rows = s_.rows_of(s), offsets = s_.offsets_of(s);
  for (std::size_t k = 0; k < rows.size(); ++k) {
    const int first = s_.first_column[rows[k]], size = s_.first_column[rows[k] + 1] - first;
    std::copy_n(x + first, size, y.begin() + shape.top + offsets[k]);
  }
  kernels_.backward(panel(s), shape.stride, shape.columns, static_cast<int>(shape.rows), y.data());
  std::copy_n(y.begin(), shape.columns, own);
}

void SupernodalCholesky::solve(std::span<double> x, ThreadPool& pool) {
  work_.resize(pool.num_threads());
  const int parts = static_cast<int>(outside_.size());
  pool.parallel_for_worker(parts, [&](int part, int worker) {
    Outside& outside = outside_[part];
    std::ranges::fill(outside.taken, 0.0);
    for (int s = outside.part->first; s <= outside.part->last; ++s)
      forward(s, x.data(), &outside, work_[worker].rows);
  });
  for (const Outside& taken : outside_) {
    for (std::size_t k = 0; k < taken.part->rows.size(); ++k) {
      const int place = taken.part->rows[k], first = s_.first_column[place];
      for (int c = first; c < s_.first_column[place + 1]; ++c)
        x[c] += taken.taken[taken.part->row_offset[k] + c - first];
    }
  }
  for (int s : s_.top) forward(s, x.data(), nullptr, work_[0].rows);
  for (auto s = s_.top.rbegin(); s != s_.top.rend(); ++s) backward(*s, x.data(), work_[0].rows);
  pool.parallel_for_worker(parts, [&](int part, int worker) {
    const Subtrees& subtrees = *outside_[part].part;
    for (int s = subtrees.last; s >= subtrees.first; --s) backward(s, x.data(), work_[worker].rows);
  });
}

void SupernodalCholesky::solve(Eigen::MatrixXd& x, ThreadPool& pool) const {
  pool.parallel_for(static_cast<int>(x.cols()), [&](int column) {
    std::vector<double> buffer;
    double* values = x.col(column).data();
    for (int s = 0; s < s_.count(); ++s) forward(s, values, nullptr, buffer);
    for (int s = s_.count() - 1; s >= 0; --s) backward(s, values, buffer);
  });
}

Eigen::MatrixXd SupernodalCholesky::inverse_product(const SparseEntries& x,
                                                    int columns,
                                                    HalfSolution& work) const {
  if (work.values.cols() < columns) work.values.setZero(s_.first_column.back(), columns);
  work.reached.resize(static_cast<std::size_t>(s_.count()));
  for (const auto& entry : x) {
    work.values(entry.row(), entry.col()) = entry.value();
    const auto place = std::ranges::upper_bound(s_.first_column, entry.row()) - 1;
    work.reached[s_.of_place[place - s_.first_column.begin()]] = 1;
  }
  Eigen::MatrixXd product = Eigen::MatrixXd::Zero(columns, columns);
  for (int s = 0; s < s_.count(); ++s) {
    if (work.reached[s] == 0) continue;
    forward(s, work, columns);
    auto own = work.values.block(s_.columns_begin(s), 0, s_.panel[s].columns, columns);
    product.noalias() += own.transpose() * own;
    own.setZero();
    work.reached[s] = 0;
  }
  return product;
}

// The columns of one supernode as above, for several right-hand sides.
void SupernodalCholesky::forward(int s, HalfSolution& work, int columns) const {
  const SupernodePanel& shape = s_.panel[s];
  auto own = work.values.block(s_.columns_begin(s), 0, shape.columns, columns);
  work.panel.setZero(shape.rows, columns);
  work.panel.topRows(shape.columns) = own;
  forward_columns(kernels_, panel(s), shape.stride, shape.columns, work.panel);
  own = work.panel.topRows(shape.columns);
  const std::span<const int> rows = s_.rows_of(s), offsets = s_.offsets_of(s);
  for (std::size_t k = 0; k < rows.size(); ++k) {
    const int first = s_.first_column[rows[k]], size = s_.first_column[rows[k] + 1] - first;
    work.values.block(first, 0, size, columns) +=
        work.panel.block(shape.top + offsets[k], 0, size, columns);
    work.reached[s_.of_place[rows[k]]] = 1;
  }
}

double SupernodalCholesky::log_determinant() const {
  double sum = 0.0;
  for (int s = 0; s < s_.count(); ++s) {
    for (int c = 0; c < s_.panel[s].columns; ++c)
      sum += std::log(panel(s)[c * (s_.panel[s].stride + 1)]);
  }
  return 2.0 * sum;
}

}  // namespace sfmcpp::linear

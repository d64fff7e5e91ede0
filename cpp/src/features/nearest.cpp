#include "sfmcpp/features/nearest.hpp"

#include <algorithm>
#include <string>
#include <tuple>

#include "sfmcpp/core/aligned.hpp"
#include "sfmcpp/core/error.hpp"
#include "sfmcpp/core/isa.hpp"
#include "sfmcpp/features/nearest_kernels.hpp"

namespace sfmcpp::features {
namespace {

// Of one task: few enough that its minima and those descriptors stay in the cache while panels pass
// by, a multiple of the rows of every tile.
constexpr int kRowsOfTask = 192;
constexpr int kShift = 128;

int rounded_up(int count, int unit) { return (count + unit - 1) / unit * unit; }

// What PanelTask says of descriptors, `width` side by side, filled up with zeros.
struct Packed {
  AlignedVector<std::uint32_t> groups;
  AlignedVector<int> terms;
  int count, width, num_groups;

  // `shift` is taken from each element here, or the twofold of its products from the terms.
  Packed(const Descriptors& descriptors, int tile_width, bool in_bytes, bool is_row);
};

std::uint32_t group_of(const std::uint8_t* elements, int count, bool in_bytes, int shift) {
  std::uint32_t group = 0;
  const int bits = in_bytes ? 8 : 16;
  for (int k = 0; k < count; ++k) {
    const auto value = static_cast<std::uint32_t>(elements[k] - shift);
    group |= (in_bytes ? value & 0xffU : value) << (bits * k);
  }
  return group;
}

int term_of(const std::uint8_t* elements, int dimension, int shift) {
  int squares = 0, sum = 0;
  for (int k = 0; k < dimension; ++k) {
    squares += elements[k] * elements[k];
    sum += elements[k];
  }
  return squares - 2 * shift * sum;
}

Packed::Packed(const Descriptors& descriptors, int tile_width, bool in_bytes, bool is_row)
    : count(rounded_up(descriptors.count, tile_width)), width(tile_width) {
  const int in_group = in_bytes ? 4 : 2, dimension = descriptors.dimension;
  const int shift = in_bytes ? kShift : 0;
  num_groups = (dimension + in_group - 1) / in_group;
  groups.assign(static_cast<std::size_t>(count) * num_groups, 0);
  terms.assign(count, kPadding);
  for (int k = 0; k < descriptors.count; ++k) {
    const std::uint8_t* elements = descriptors.data + static_cast<long>(k) * dimension;
    terms[k] = term_of(elements, dimension, is_row ? 0 : shift);
    std::uint32_t* out = groups.data() + static_cast<long>(k / width) * width * num_groups;
    out += k % width;
    for (int group = 0; group < num_groups; ++group) {
      const int begin = group * in_group;
      out[static_cast<long>(group) * width] = group_of(
          elements + begin, std::min(in_group, dimension - begin), in_bytes, is_row ? shift : 0);
    }
  }
}

struct Minima {
  AlignedVector<int> best, second, index;

  explicit Minima(std::size_t size)
      : best(size, kPadding), second(size, kPadding), index(size, -1) {}

  Smallest begin() { return {best.data(), second.data(), index.data()}; }
  void take(std::size_t at, int distance, int second_distance, int number);
};

// Of equal ones the lowest, in whatever order they come.
void Minima::take(std::size_t at, int distance, int second_distance, int number) {
  second[at] = std::min({std::max(best[at], distance), second[at], second_distance});
  if (std::tie(distance, number) < std::tie(best[at], index[at])) {
    best[at] = distance;
    index[at] = number;
  }
}

// What one worker needs.
struct Scratch {
  Minima of_rows, of_panel, of_columns;
};

class Search {
 public:
  Search(const Descriptors& first,
         const Descriptors& second,
         bool both_ways,
         const NearestKernels& kernels)
      : kernels_(kernels),
        rows_(first, kernels.rows, kernels.in_bytes, true),
        columns_(second, kernels.columns, kernels.in_bytes, false),
        both_ways_(both_ways),
        nearest_of_rows_(rows_.count) {}

  void run(ThreadPool& pool) {
    const Scratch fresh{Minima(static_cast<std::size_t>(kRowsOfTask) * kernels_.lanes),
                        Minima(kernels_.columns),
                        Minima(both_ways_ ? columns_.count : 0)};
    scratch_.assign(pool.num_threads(), fresh);
    const int tasks = ThreadPool::num_parts(rows_.count, kRowsOfTask);
    pool.parallel_for_worker(
        tasks, [this](int task, int worker) { run_task(task * kRowsOfTask, scratch_[worker]); });
  }

  Neighbours of_rows(int count) const { return neighbours(nearest_of_rows_, count); }
  Neighbours of_columns(int count) const;

 private:
  void run_task(int first_row, Scratch& scratch);
  void take_columns(int first_column, Scratch& scratch) const;
  void take_rows(int first_row, int num_rows, const Minima& lanes);
  static Neighbours neighbours(const Minima& minima, int count);

  const NearestKernels& kernels_;
  const Packed rows_, columns_;
  const bool both_ways_;
  Minima nearest_of_rows_;
  std::vector<Scratch> scratch_;
};

void Search::run_task(int first_row, Scratch& scratch) {
  const int num_rows = std::min(kRowsOfTask, rows_.count - first_row);
  scratch.of_rows = Minima(static_cast<std::size_t>(num_rows) * kernels_.lanes);
  PanelTask task{};
  task.rows = rows_.groups.data() + static_cast<long>(first_row) * rows_.num_groups;
  task.row_terms = rows_.terms.data() + first_row;
  task.num_rows = num_rows;
  task.first_row = first_row;
  task.num_groups = rows_.num_groups;
  task.of_rows = scratch.of_rows.begin();
  task.of_columns = scratch.of_panel.begin();
  for (int column = 0; column < columns_.count; column += kernels_.columns) {
    task.panel = columns_.groups.data() + static_cast<long>(column) * columns_.num_groups;
    task.panel_terms = columns_.terms.data() + column;
    task.first_column = column;
    (both_ways_ ? kernels_.both_ways : kernels_.rows_alone)(task);
    if (both_ways_) take_columns(column, scratch);
  }
  take_rows(first_row, num_rows, scratch.of_rows);
}

void Search::take_columns(int first_column, Scratch& scratch) const {
  const Minima& panel = scratch.of_panel;
  for (int k = 0; k < kernels_.columns; ++k)
    scratch.of_columns.take(first_column + k, panel.best[k], panel.second[k], panel.index[k]);
}

void Search::take_rows(int first_row, int num_rows, const Minima& lanes) {
  for (int row = 0; row < num_rows; ++row) {
    for (int lane = 0; lane < kernels_.lanes; ++lane) {
      const std::size_t at = static_cast<std::size_t>(row) * kernels_.lanes + lane;
      nearest_of_rows_.take(first_row + row, lanes.best[at], lanes.second[at], lanes.index[at]);
    }
  }
}

Neighbours Search::of_columns(int count) const {
  Minima merged(count);
  for (const Scratch& scratch : scratch_) {
    const Minima& from = scratch.of_columns;
    for (int k = 0; k < count; ++k) merged.take(k, from.best[k], from.second[k], from.index[k]);
  }
  return neighbours(merged, count);
}

Neighbours Search::neighbours(const Minima& minima, int count) {
  Neighbours result{std::vector<int>(count, -1),
                    std::vector<int>(count, kPadding),
                    std::vector<int>(count, kPadding)};
  for (int k = 0; k < count; ++k) {
    if (minima.best[k] < kNoDistance) {
      result.index[k] = minima.index[k];
      result.squared_distance[k] = minima.best[k];
    }
    if (minima.second[k] < kNoDistance) result.second_squared_distance[k] = minima.second[k];
  }
  return result;
}

void check(const Descriptors& first, const Descriptors& second) {
  for (int number : {first.count, second.count, first.dimension, second.dimension}) {
    if (number < 0)
      throw InvalidArgument("descriptors: " + std::to_string(number) + ", must not be negative");
  }
  if (first.dimension != second.dimension) {
    throw InvalidArgument("descriptors: of " + std::to_string(first.dimension) + " and " +
                          std::to_string(second.dimension) + " elements, must have equally many");
  }
  if (first.dimension > kMaxDimension) {
    throw InvalidArgument("descriptors: of " + std::to_string(first.dimension) +
                          " elements, must be of at most " + std::to_string(kMaxDimension));
  }
}

}  // namespace

NearestKernels nearest_kernels(bool byte_products) {
  return SFMCPP_FOR_ACTIVE_ISA(nearest_kernels_of(byte_products));
}

MutualNeighbours nearest_both_ways(const Descriptors& first,
                                   const Descriptors& second,
                                   ThreadPool& pool,
                                   const NearestKernels& kernels) {
  check(first, second);
  Search search(first, second, true, kernels);
  search.run(pool);
  return {search.of_rows(first.count), search.of_columns(second.count)};
}

Neighbours nearest_of_first(const Descriptors& first,
                            const Descriptors& second,
                            ThreadPool& pool,
                            const NearestKernels& kernels) {
  check(first, second);
  Search search(first, second, false, kernels);
  search.run(pool);
  return search.of_rows(first.count);
}

}  // namespace sfmcpp::features

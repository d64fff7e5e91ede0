#include "sfmcpp/linear/schur_rows.hpp"

#include <algorithm>

#include "sfmcpp/linear/block_layout.hpp"
#include "sfmcpp/linear/reduced_structure.hpp"

namespace sfmcpp::linear {
namespace {

// More pairs than this for each observation take more memory than the Jacobian is worth.
constexpr double kMostPairs = 8.0;
// Of a part of rows: as many as stay in the cache beside what they read.
constexpr std::size_t kPairsOfPart = 32768;

// Numbers of the blocks of row i by their second camera; the first, (i, i), has `first`.
void number_blocks(const CameraPattern& pattern, int i, int first, std::vector<int>& of_camera) {
  for (int j : pattern.columns_of_row(i)) of_camera[j] = first++;
}

// Calls f(b) for the observations of the point of observation a in later cameras.
template <class F>
void for_each_partner(const ObservationGraph& graph, int a, const F& f) {
  const int end = graph.point_begin[graph.point[a] + 1];
  for (int position = graph.rank[a] + 1; position < end; ++position) f(graph.of_point[position]);
}

// Calls f(a, b) for the pairs of row i, in the order of a and then of b.
template <class F>
void for_each_pair(const ObservationGraph& graph, int i, const F& f) {
  for (int a = graph.camera_begin[i]; a < graph.camera_begin[i + 1]; ++a)
    for_each_partner(graph, a, [&](int b) { f(a, b); });
}

// Calls f(i, numbers) for every row in parallel, with the numbers of its blocks.
template <class F>
void for_each_row(const NormalEquations& normal, const CameraPattern& pattern, const F& f) {
  std::vector<std::vector<int>> numbers(normal.pool().num_threads(),
                                        std::vector<int>(normal.graph().num_cameras));
  normal.pool().parallel_for_worker(pattern.num_rows(), [&](int i, int worker) {
    number_blocks(pattern, i, 0, numbers[worker]);
    f(i, numbers[worker]);
  });
}

}  // namespace

double pair_list_bytes(const SchurKernels& kernels, double pairs, double observations) {
  const bool are_kept = kernels.sum_pairs != nullptr && pairs <= kMostPairs * observations;
  return are_kept ? pairs * sizeof(ObservationPair) : 0.0;
}

PairLists::PairLists(const NormalEquations& normal, const CameraPattern& pattern) {
  const ObservationGraph& graph = normal.graph();
  const double observations = graph.num_observations();
  const double pairs = num_pair_updates(graph) - observations;
  if (pair_list_bytes(normal.kernels(), pairs, observations) == 0.0) return;
  std::vector<long> count(static_cast<std::size_t>(pattern.num_blocks()) + 1, 0);
  for_each_row(normal, pattern, [&](int i, const std::vector<int>& number) {
    long* of_row = count.data() + pattern.row_begin[i];
    for_each_pair(graph, i, [&](int, int b) { ++of_row[number[graph.camera[b]]]; });
  });
  begin_.resize(count.size());
  for (std::size_t k = 0; k + 1 < count.size(); ++k) begin_[k + 1] = begin_[k] + count[k];
  pairs_.resize(static_cast<std::size_t>(begin_.back()));
  std::vector<long> place = begin_;
  for_each_row(normal, pattern, [&](int i, const std::vector<int>& number) {
    long* of_row = place.data() + pattern.row_begin[i];
    for_each_pair(graph, i, [&](int a, int b) {
      pairs_[of_row[number[graph.camera[b]]]++] = {a, b};
    });
  });
}

SchurRows::SchurRows(const NormalEquations& normal,
                     const PointElimination& elimination,
                     const CameraPattern& pattern)
    : normal_(normal),
      elimination_(elimination),
      pattern_(pattern),
      pairs_(normal, pattern),
      sums_in_parts_(normal.kernels().sum_pairs != nullptr && pairs_.empty()),
      scratch_(normal.pool().num_threads()) {
  const ObservationGraph& graph = normal.graph();
  int most = 0;
  for (int i = 0; i < graph.num_cameras; ++i)
    most = std::max(most, graph.observations_of_camera(i));
  for (Scratch& scratch : scratch_) {
    for (int k = 0; k < rows_at_once(); ++k)
      scratch.rows[k].block_of_camera.resize(graph.num_cameras);
    if (normal.kernels().sum_pairs == nullptr) continue;
    scratch.whitened.resize(kWhitenedNumbers * static_cast<std::size_t>(most) * rows_at_once());
    if (sums_in_parts_) scratch.number_of_column.assign(graph.num_cameras, -1);
  }
}

void SchurRows::form(std::span<const int> cameras, std::span<const Place> places, int worker) {
  Scratch& scratch = scratch_[worker];
  const auto num_rows = static_cast<int>(cameras.size());
  for (int k = 0; k < num_rows; ++k) {
    Row& row = scratch.rows[k];
    row.camera = cameras[k];
    row.blocks = places[k].blocks;
    number_blocks(pattern_, row.camera, -1, row.block_of_camera);
    form_diagonal(row.camera, places[k]);
    std::fill_n(row.blocks, num_blocks_behind(row.camera) * area(), 0.0);
  }
  if (sums_in_parts_) return add_pairs_in_parts(num_rows, scratch);
  if (!pairs_.empty()) return add_kept_pairs(scratch);
  add_row(scratch.rows[0]);
}

void SchurRows::form_diagonal(int i, const Place& place) const {
  const ObservationGraph& graph = normal_.graph();
  normal_.kernels().schur_diagonal({.begin = graph.camera_begin[i],
                                    .end = graph.camera_begin[i + 1],
                                    .point = graph.point.data(),
                                    .jacobian = normal_.jacobian(),
                                    .factors = elimination_.factors(),
                                    .gradient = normal_.unrounded_gradient(i),
                                    .diagonal = place.diagonal,
                                    .rhs = place.rhs,
                                    .grid = grid_ ? grid_->of_camera(i) : nullptr,
                                    .compensated_gradient = normal_.is_compensated()});
}

void SchurRows::add_row(const Row& row) const {
  const ObservationGraph& graph = normal_.graph();
  if (grid_) lift(row, 1.0);
  normal_.kernels().schur_row({.graph = graph.view(),
                               .begin = graph.camera_begin[row.camera],
                               .end = graph.camera_begin[row.camera + 1],
                               .jacobian = normal_.jacobian(),
                               .factors = elimination_.factors(),
                               .block_of_camera = row.block_of_camera.data(),
                               .blocks = row.blocks});
  if (grid_) lift(row, -1.0);
}

// Onto the grid, or with sign −1 back.
void SchurRows::lift(const Row& row, double sign) const {
  const int size = normal_.map().camera_size;
  const double* of_row = grid_->of_camera(row.camera);
  double* at = row.blocks;
  for (int k = 0; k < num_blocks_behind(row.camera); ++k) {
    const double* of_column = grid_->of_camera(pattern_.columns_behind(row.camera)[k]);
    for (int first = 0, width = 0; first < size; first += width) {
      width = panel_width(size - first);
      for (int c = 0; c < size; ++c) {
        const double middle = sign * 1.5 * of_column[c];
        for (int r = first; r < first + width; ++r) *at++ += middle * of_row[r];
      }
    }
  }
}

int SchurRows::num_blocks_behind(int i) const {
  return static_cast<int>(pattern_.columns_behind(i).size());
}

void SchurRows::add_kept_pairs(Scratch& scratch) const {
  const ObservationGraph& graph = normal_.graph();
  const Row& row = scratch.rows[0];
  const int i = row.camera, count = num_blocks_behind(i);
  const long* begin = pairs_.begin_of_row(pattern_.row_begin[i]);
  scratch.sums_of_rows = {
      sum_of_row(row, graph.camera_begin[i], graph.camera_begin[i + 1], scratch.whitened.data())};
  scratch.sums_of_blocks.clear();
  for (int k = 0; k < count; ++k)
    scratch.sums_of_blocks.push_back({.row = 0,
                                      .column = pattern_.columns_behind(i)[k],
                                      .end = begin[k + 1] - begin[0],
                                      .sum = row.blocks + area() * k});
  sum_pairs(pairs_.pairs() + begin[0], scratch);
}

void SchurRows::add_pairs_in_parts(int num_rows, Scratch& scratch) const {
  for (int k = 0; k < num_rows; ++k)
    scratch.rows[k].next = normal_.graph().camera_begin[scratch.rows[k].camera];
  number_columns(num_rows, scratch);
  while (find_part(num_rows, scratch)) {
    sort_part(num_rows, scratch);
    sum_pairs(scratch.pairs.data(), scratch);
  }
  for (int j : scratch.columns) scratch.number_of_column[j] = -1;
}

// Those of any of the rows.
void SchurRows::number_columns(int num_rows, Scratch& scratch) const {
  scratch.columns.clear();
  for (int k = 0; k < num_rows; ++k) {
    const int i = scratch.rows[k].camera;
    for (const int j : pattern_.columns_behind(i)) {
      if (scratch.number_of_column[j] >= 0) continue;
      scratch.number_of_column[j] = static_cast<int>(scratch.columns.size());
      scratch.columns.push_back(j);
    }
  }
}

// The pairs of the next points, and which observations of each row these are. False after the last.
bool SchurRows::find_part(int num_rows, Scratch& scratch) const {
  const ObservationGraph& graph = normal_.graph();
  const std::span rows(scratch.rows.data(), num_rows);
  const auto next_point = [&] {
    int next = graph.num_points;
    for (const Row& row : rows) {
      if (row.next < graph.camera_begin[row.camera + 1])
        next = std::min(next, graph.point[row.next]);
    }
    return next;
  };
  std::array<int, kMostRows> begin{};
  for (int k = 0; k < num_rows; ++k) begin[k] = rows[k].next;
  scratch.found.clear();
  int p = next_point();
  if (p == graph.num_points) return false;
  for (; p < graph.num_points && scratch.found.size() < kPairsOfPart; p = next_point()) {
    for (int k = 0; k < num_rows; ++k) {
      const int a = rows[k].next;
      if (a == graph.camera_begin[rows[k].camera + 1] || graph.point[a] != p) continue;
      for_each_partner(graph, a, [&](int b) {
        const int column = scratch.number_of_column[graph.camera[b]];
        scratch.found.push_back({column * num_rows + k, {a, b}});
      });
      ++rows[k].next;
    }
  }
  scratch.sums_of_rows.clear();
  double* whitened = scratch.whitened.data();
  for (int k = 0; k < num_rows; ++k) {
    scratch.sums_of_rows.push_back(sum_of_row(rows[k], begin[k], rows[k].next, whitened));
    whitened += kWhitenedNumbers * static_cast<long>(rows[k].next - begin[k]);
  }
  return true;
}

// By block: what all rows read of a camera comes together.
void SchurRows::sort_part(int num_rows, Scratch& scratch) const {
  const auto num_keys = static_cast<int>(scratch.columns.size()) * num_rows;
  std::vector<long>& begin = scratch.pair_begin;
  begin.assign(static_cast<std::size_t>(num_keys) + 2, 0);
  for (const FoundPair& found : scratch.found) ++begin[found.key + 2];
  for (int k = 0; k < num_keys; ++k) begin[k + 2] += begin[k + 1];
  scratch.pairs.resize(scratch.found.size());
  for (const FoundPair& found : scratch.found) scratch.pairs[begin[found.key + 1]++] = found.pair;
  scratch.sums_of_blocks.clear();
  for (int key = 0; key < num_keys; ++key) {
    if (begin[key] == begin[key + 1]) continue;
    const int k = key % num_rows, j = scratch.columns[key / num_rows];
    const Row& row = scratch.rows[k];
    scratch.sums_of_blocks.push_back({.row = k,
                                      .column = j,
                                      .end = begin[key + 1],
                                      .sum = row.blocks + area() * row.block_of_camera[j]});
  }
}

PairSums::Row SchurRows::sum_of_row(const Row& row, int begin, int end, double* whitened) const {
  return {.begin = begin,
          .end = end,
          .whitened = whitened,
          .grid = grid_ ? grid_->of_camera(row.camera) : nullptr};
}

// Of the rows and blocks of the scratch.
void SchurRows::sum_pairs(const ObservationPair* pairs, const Scratch& scratch) const {
  normal_.kernels().sum_pairs({.rows = scratch.sums_of_rows,
                               .blocks = scratch.sums_of_blocks,
                               .pairs = pairs,
                               .point = normal_.graph().point.data(),
                               .jacobian = normal_.jacobian(),
                               .factors = elimination_.factors(),
                               .grid = grid_ ? grid_->powers() : nullptr});
}

}  // namespace sfmcpp::linear

#include "sfmcpp/linear/schur_rows.hpp"

#include <algorithm>

#include "sfmcpp/linear/block_layout.hpp"
#include "sfmcpp/linear/reduced_structure.hpp"

namespace sfmcpp::linear {
namespace {

// More pairs than this for each observation take more memory than the Jacobian is worth.
constexpr double kMostPairs = 8.0;
// Of a part of a row: as many as stay in the cache beside what they read.
constexpr std::size_t kPairsOfPart = 16384;

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
      scratch_(normal.pool().num_threads()) {
  const ObservationGraph& graph = normal.graph();
  int most = 0;
  for (int i = 0; i < graph.num_cameras; ++i)
    most = std::max(most, graph.observations_of_camera(i));
  for (Scratch& scratch : scratch_) {
    scratch.block_of_camera.resize(graph.num_cameras);
    if (normal.kernels().sum_pairs == nullptr) continue;
    scratch.whitened.resize(kWhitenedNumbers * static_cast<std::size_t>(most));
  }
}

void SchurRows::form(int i, int worker, double* diagonal, double* blocks, double* rhs) {
  const ObservationGraph& graph = normal_.graph();
  const SchurKernels& kernels = normal_.kernels();
  Scratch& scratch = scratch_[worker];
  number_blocks(pattern_, i, -1, scratch.block_of_camera);
  kernels.schur_diagonal({.begin = graph.camera_begin[i],
                          .end = graph.camera_begin[i + 1],
                          .point = graph.point.data(),
                          .jacobian = normal_.jacobian(),
                          .factors = elimination_.factors(),
                          .gradient = normal_.unrounded_gradient(i),
                          .diagonal = diagonal,
                          .rhs = rhs,
                          .grid = grid_ ? grid_->of_camera(i) : nullptr,
                          .compensated_gradient = normal_.is_compensated()});
  const long size = normal_.map().camera_size;
  std::fill_n(blocks, num_blocks_behind(i) * size * size, 0.0);
  if (!pairs_.empty()) return add_kept_pairs(i, scratch, blocks);
  if (kernels.sum_pairs != nullptr) return add_pairs_in_parts(i, scratch, blocks);
  if (grid_) lift(i, 1.0, blocks);
  add_row(i, scratch, blocks);
  if (grid_) lift(i, -1.0, blocks);
}

void SchurRows::add_row(int i, const Scratch& scratch, double* blocks) const {
  const ObservationGraph& graph = normal_.graph();
  normal_.kernels().schur_row({.graph = graph.view(),
                               .begin = graph.camera_begin[i],
                               .end = graph.camera_begin[i + 1],
                               .jacobian = normal_.jacobian(),
                               .factors = elimination_.factors(),
                               .block_of_camera = scratch.block_of_camera.data(),
                               .blocks = blocks});
}

// Onto the grid, or with sign −1 back.
void SchurRows::lift(int i, double sign, double* blocks) const {
  const int size = normal_.map().camera_size;
  const double* of_row = grid_->of_camera(i);
  for (int k = 0; k < num_blocks_behind(i); ++k, blocks += static_cast<long>(size) * size) {
    const double* of_column = grid_->of_camera(pattern_.columns_behind(i)[k]);
    for (int r = 0; r < size; ++r) {
      for (int c = 0; c < size; ++c)
        blocks[panel_index(size, r, c)] += sign * 1.5 * of_row[r] * of_column[c];
    }
  }
}

int SchurRows::num_blocks_behind(int i) const {
  return static_cast<int>(pattern_.columns_behind(i).size());
}

void SchurRows::add_kept_pairs(int i, Scratch& scratch, double* blocks) const {
  add_pairs(i,
            {.begin = normal_.graph().camera_begin[i],
             .end = normal_.graph().camera_begin[i + 1],
             .pairs = pairs_.pairs(),
             .pair_begin = pairs_.begin_of_row(pattern_.row_begin[i]),
             .num_blocks = num_blocks_behind(i),
             .blocks = blocks},
            scratch);
}

void SchurRows::add_pairs_in_parts(int i, Scratch& scratch, double* blocks) const {
  const ObservationGraph& graph = normal_.graph();
  int begin = graph.camera_begin[i];
  while (begin < graph.camera_begin[i + 1]) {
    const int end = find_part(begin, graph.camera_begin[i + 1], scratch);
    sort_part(num_blocks_behind(i), scratch);
    add_pairs(i,
              {.begin = begin,
               .end = end,
               .pairs = scratch.pairs.data(),
               .pair_begin = scratch.pair_begin.data(),
               .num_blocks = num_blocks_behind(i),
               .blocks = blocks},
              scratch);
    begin = end;
  }
}

// The pairs of the observations from `begin` on, and where the part of the row ends.
int SchurRows::find_part(int begin, int last, Scratch& scratch) const {
  const ObservationGraph& graph = normal_.graph();
  scratch.found.clear();
  int a = begin;
  do {
    for_each_partner(graph, a, [&](int b) {
      scratch.found.push_back({scratch.block_of_camera[graph.camera[b]], {a, b}});
    });
  } while (++a < last && scratch.found.size() < kPairsOfPart);
  return a;
}

void SchurRows::sort_part(int num_blocks, Scratch& scratch) {
  std::vector<long>& begin = scratch.pair_begin;
  begin.assign(static_cast<std::size_t>(num_blocks) + 2, 0);
  for (const FoundPair& found : scratch.found) ++begin[found.block + 2];
  for (int k = 0; k < num_blocks; ++k) begin[k + 2] += begin[k + 1];
  scratch.pairs.resize(scratch.found.size());
  for (const FoundPair& found : scratch.found) scratch.pairs[begin[found.block + 1]++] = found.pair;
}

void SchurRows::add_pairs(int i, PairSums sums, Scratch& scratch) const {
  if (grid_) {
    sums.grid = grid_->powers();
    sums.grid_of_row = grid_->of_camera(i);
    sums.columns = pattern_.columns_behind(i).data();
  }
  sums.point = normal_.graph().point.data();
  sums.jacobian = normal_.jacobian();
  sums.factors = elimination_.factors();
  sums.whitened = scratch.whitened.data();
  normal_.kernels().sum_pairs(sums);
}

}  // namespace sfmcpp::linear

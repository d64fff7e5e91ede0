#include "sfmcpp/linear/schur_rows.hpp"

#include <algorithm>

#include "sfmcpp/linear/reduced_structure.hpp"

namespace sfmcpp::linear {
namespace {

// More pairs than this for each observation take more memory than the Jacobian is worth.
constexpr double kMostPairs = 8.0;

// Numbers of the blocks of row i by their second camera; the first, (i, i), has `first`.
void number_blocks(const CameraPattern& pattern, int i, int first, std::vector<int>& of_camera) {
  const long begin = pattern.row_begin[i];
  for (long block = begin; block < pattern.row_begin[i + 1]; ++block)
    of_camera[pattern.column[block]] = first + static_cast<int>(block - begin);
}

// Calls f(a, b) for the pairs of row i, in the order of a and then of b.
template <class F>
void for_each_pair(const ObservationGraph& graph, int i, const F& f) {
  for (int a = graph.camera_begin[i]; a < graph.camera_begin[i + 1]; ++a) {
    const int end = graph.point_begin[graph.point[a] + 1];
    for (int position = graph.rank[a] + 1; position < end; ++position)
      f(a, graph.of_point[position]);
  }
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

PairLists::PairLists(const NormalEquations& normal, const CameraPattern& pattern) {
  const ObservationGraph& graph = normal.graph();
  const double observations = graph.num_observations();
  const double pairs = num_pair_updates(graph) - observations;
  if (!normal.kernels().sums_pairs || pairs == 0.0 || pairs > kMostPairs * observations) return;
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
    if (!pairs_.empty()) scratch.whitened.resize(kWhitenedNumbers * static_cast<std::size_t>(most));
  }
}

void SchurRows::form(int i, int worker, double* diagonal, double* blocks, double* rhs) {
  const ObservationGraph& graph = normal_.graph();
  Scratch& scratch = scratch_[worker];
  number_blocks(pattern_, i, -1, scratch.block_of_camera);
  const long first = pattern_.row_begin[i], size = normal_.map().camera_size;
  const int num_blocks = static_cast<int>(pattern_.row_begin[i + 1] - first) - 1;
  if (pairs_.empty()) std::fill_n(blocks, num_blocks * size * size, 0.0);
  normal_.kernels().schur_row({.graph = graph.view(),
                               .begin = graph.camera_begin[i],
                               .end = graph.camera_begin[i + 1],
                               .jacobian = normal_.jacobian(),
                               .factors = elimination_.factors(),
                               .block_of_camera = scratch.block_of_camera.data(),
                               .diagonal = diagonal,
                               .blocks = blocks,
                               .gradient = normal_.unrounded_gradient(i),
                               .rhs = rhs,
                               .pairs = pairs_.empty() ? nullptr : pairs_.pairs(),
                               .pair_begin = pairs_.empty() ? nullptr : pairs_.begin_of_row(first),
                               .num_blocks = num_blocks,
                               .whitened = scratch.whitened.data()});
}

}  // namespace sfmcpp::linear

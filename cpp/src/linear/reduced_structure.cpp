#include "sfmcpp/linear/reduced_structure.hpp"

#include <algorithm>
#include <bit>
#include <cstdint>
#include <utility>

#include "sfmcpp/linear/normal_equations.hpp"

namespace sfmcpp::linear {
namespace {

constexpr int kBits = 64;
constexpr int kRowsPerTask = 32;

// Those of 64 consecutive cameras that see a point.
struct Word {
  int number = 0;
  std::uint64_t cameras = 0;
};

// The cameras of every point as words, ascending.
struct TrackWords {
  std::vector<std::int64_t> begin;  // of each point, and the end
  std::vector<Word> words;
};

// Calls f(word) for the words of a point.
template <class F>
void for_each_word(const ObservationGraph& graph, int p, const F& f) {
  Word word;
  for (int k = graph.point_begin[p]; k < graph.point_begin[p + 1]; ++k) {
    const int camera = graph.camera[graph.of_point[k]];
    if (camera / kBits != word.number && word.cameras != 0) {
      f(word);
      word.cameras = 0;
    }
    word.number = camera / kBits;
    word.cameras |= std::uint64_t{1} << (camera % kBits);
  }
  if (word.cameras != 0) f(word);
}

TrackWords make_track_words(const ObservationGraph& graph, ThreadPool& pool) {
  TrackWords tracks;
  tracks.begin.assign(static_cast<std::size_t>(graph.num_points) + 1, 0);
  for_each_point(pool, graph.num_points, [&](int p) {
    for_each_word(graph, p, [&](const Word&) { ++tracks.begin[p + 1]; });
  });
  for (int p = 0; p < graph.num_points; ++p) tracks.begin[p + 1] += tracks.begin[p];
  tracks.words.resize(static_cast<std::size_t>(tracks.begin.back()));
  for_each_point(pool, graph.num_points, [&](int p) {
    std::int64_t place = tracks.begin[p];
    for_each_word(graph, p, [&](const Word& word) { tracks.words[place++] = word; });
  });
  return tracks;
}

// Gathers the cameras of a row.
class RowOfCameras {
 public:
  explicit RowOfCameras(int num_cameras)
      : num_cameras_(num_cameras), seen_(static_cast<std::size_t>(num_cameras) / kBits + 1) {}

  void start(int row) {
    row_ = row;
    missing_ = num_cameras_ - row - 1;
  }
  bool is_full() const { return missing_ == 0; }
  int first_word() const { return row_ / kBits; }

  // Cameras before the row are passed over.
  void add(const Word& word) {
    std::uint64_t cameras = word.cameras;
    if (word.number == first_word()) cameras &= ~std::uint64_t{1} << (row_ % kBits);
    std::uint64_t& seen = seen_[word.number];
    cameras &= ~seen;
    if (cameras == 0) return;
    if (seen == 0) touched_.push_back(word.number);
    seen |= cameras;
    missing_ -= std::popcount(cameras);
  }
  void add(int camera) { add({camera / kBits, std::uint64_t{1} << (camera % kBits)}); }

  // Appends the row and its later cameras, and forgets them.
  void append_to(std::vector<int>& columns) {
    columns.push_back(row_);
    std::sort(touched_.begin(), touched_.end());
    for (int number : touched_) {
      for (std::uint64_t left = seen_[number]; left != 0; left &= left - 1)
        columns.push_back(kBits * number + std::countr_zero(left));
      seen_[number] = 0;
    }
    touched_.clear();
  }

 private:
  int num_cameras_;
  int row_ = 0;
  int missing_ = 0;                  // later cameras not met yet
  std::vector<std::uint64_t> seen_;  // cameras after the row
  std::vector<int> touched_;         // words of `seen_` that are not zero
};

void add_tracks(const ObservationGraph& graph,
                const TrackWords& tracks,
                int camera,
                RowOfCameras& row) {
  const int end = graph.camera_begin[camera + 1];
  for (int a = graph.camera_begin[camera]; a < end && !row.is_full(); ++a) {
    const int p = graph.point[a];
    for (std::int64_t k = tracks.begin[p + 1];
         k > tracks.begin[p] && tracks.words[k - 1].number >= row.first_word();
         --k)
      row.add(tracks.words[k - 1]);
  }
}

std::vector<std::vector<int>> later_partners(int num_cameras, const CameraPairs& pairs) {
  std::vector<std::vector<int>> partners(pairs.empty() ? 0 : num_cameras);
  for (const auto& [i, j] : pairs) {
    if (i != j) partners[std::min(i, j)].push_back(std::max(i, j));
  }
  return partners;
}

// Rows of one task.
struct Rows {
  std::vector<int> column;
  std::vector<int> end;  // of each row, in `column`
};

CameraPattern joined(const std::vector<Rows>& parts) {
  std::size_t blocks = 0;
  for (const Rows& rows : parts) blocks += rows.column.size();
  CameraPattern pattern;
  pattern.row_begin.push_back(0);
  pattern.column.reserve(blocks);
  for (const Rows& rows : parts) {
    const auto first = static_cast<long>(pattern.column.size());
    pattern.column.insert(pattern.column.end(), rows.column.begin(), rows.column.end());
    for (int end : rows.end) pattern.row_begin.push_back(first + end);
  }
  return pattern;
}

}  // namespace

CameraPattern make_camera_pattern(const ObservationGraph& graph,
                                  const CameraPairs& pairs,
                                  ThreadPool& pool) {
  const TrackWords tracks = make_track_words(graph, pool);
  const std::vector<std::vector<int>> partners = later_partners(graph.num_cameras, pairs);
  std::vector<RowOfCameras> scratch(pool.num_threads(), RowOfCameras(graph.num_cameras));
  const int tasks = ThreadPool::num_parts(graph.num_cameras, kRowsPerTask);
  std::vector<Rows> parts(tasks);
  pool.parallel_for_worker(tasks, [&](int task, int worker) {
    RowOfCameras& row = scratch[worker];
    const int end = std::min((task + 1) * kRowsPerTask, graph.num_cameras);
    for (int i = task * kRowsPerTask; i < end; ++i) {
      row.start(i);
      if (!partners.empty()) {
        for (int j : partners[i]) row.add(j);
      }
      add_tracks(graph, tracks, i, row);
      row.append_to(parts[task].column);
      parts[task].end.push_back(static_cast<int>(parts[task].column.size()));
    }
  });
  return joined(parts);
}

CameraPattern make_global_camera_pattern(const ObservationGraph& graph,
                                         const CameraPairs& pairs,
                                         ThreadPool& pool,
                                         Exchange& exchange) {
  CameraPattern mine = make_camera_pattern(graph, pairs, pool);
  if (exchange.num_ranks() == 1) return mine;
  // Of each row how many blocks, and their columns.
  std::vector<double> rows;
  rows.reserve(mine.column.size() + mine.row_begin.size());
  for (int i = 0; i < mine.num_rows(); ++i) {
    const auto begin = mine.column.begin() + mine.row_begin[i],
               end = mine.column.begin() + mine.row_begin[i + 1];
    rows.push_back(static_cast<double>(end - begin));
    rows.insert(rows.end(), begin, end);
  }
  mine = {};
  rows = exchange.gather(rows);
  CameraPairs all;
  all.reserve(rows.size());
  int row = 0;
  for (auto next = rows.begin(); next != rows.end(); row = (row + 1) % graph.num_cameras) {
    for (const auto end = next + 1 + static_cast<long>(*next); ++next != end;)
      all.emplace_back(row, static_cast<int>(*next));
  }
  rows = {};
  return make_camera_pattern(graph, all, pool);
}

namespace {

// The distinct variable blocks that the columns of a camera belong to: its own, and shared ones.
std::vector<int> blocks_of_camera(const ParameterMap& map, int camera) {
  std::vector<int> blocks;
  for (int k = 0; k < map.camera_size; ++k) {
    const int column = map.columns_of(camera)[k];
    if (column != kNoColumn) blocks.push_back(map.block_of[column]);
  }
  std::sort(blocks.begin(), blocks.end());
  blocks.erase(std::unique(blocks.begin(), blocks.end()), blocks.end());
  return blocks;
}

}  // namespace

double num_pair_updates(const ObservationGraph& graph) {
  double pairs = 0.0;
  for (int p = 0; p < graph.num_points; ++p) {
    const double n = graph.observations_of_point(p);
    pairs += n * (n + 1) / 2;
  }
  return pairs;
}

BlockGraph make_block_graph(const CameraPattern& pattern, const ParameterMap& map) {
  BlockGraph graph;
  for (int k = 0; k < map.num_blocks(); ++k)
    graph.size.push_back(map.block_begin[k + 1] - map.block_begin[k]);
  std::vector<std::vector<int>> blocks(pattern.num_rows());
  for (int i = 0; i < pattern.num_rows(); ++i) blocks[i] = blocks_of_camera(map, i);
  for (int i = 0; i < pattern.num_rows(); ++i) {
    for (int j : pattern.columns_of_row(i)) {
      for (int a : blocks[i]) {
        for (int b : blocks[j]) {
          if (a != b) graph.edges.emplace_back(std::min(a, b), std::max(a, b));
        }
      }
    }
  }
  std::sort(graph.edges.begin(), graph.edges.end());
  graph.edges.erase(std::unique(graph.edges.begin(), graph.edges.end()), graph.edges.end());
  return graph;
}

ReducedStructure make_sparse_structure(CameraPattern pattern,
                                       const ParameterMap& map,
                                       ThreadPool& pool) {
  ReducedStructure structure{.pattern = std::move(pattern)};
  structure.graph = make_block_graph(structure.pattern, map);
  structure.ordering = order_blocks(structure.graph, pool);
  structure.supernodes = make_supernodes(structure.graph, structure.ordering);
  structure.ordering.position = structure.supernodes.position;
  structure.ordering.factor_bytes = structure.supernodes.num_bytes();
  return structure;
}

}  // namespace sfmcpp::linear

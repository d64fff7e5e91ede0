// Which cameras meet, against all pairs of cameras tried one by one.
#include "sfmcpp/linear/reduced_structure.hpp"

#include <algorithm>
#include <random>
#include <set>

#include <Eigen/SparseCholesky>
#include <gtest/gtest.h>

#include "support/random_blocks.hpp"
#include "support/random_system.hpp"
#include "support/threaded_exchange.hpp"

namespace sfmcpp::linear::camera_pattern_test {
namespace {

struct Tracks {
  int num_cameras = 0, num_points = 0;
  std::vector<int> camera, point;

  void see(int i, int p) {
    camera.push_back(i);
    point.push_back(p);
    num_points = std::max(num_points, p + 1);
  }
  ObservationGraph graph() const {
    return make_observation_graph(num_cameras, num_points, camera, point);
  }
};

// Tracks of every length up to all cameras, most of them short, over more cameras than a word has
// bits; some of neighbours, some of any cameras.
Tracks random_tracks(unsigned seed, int num_cameras, int num_points) {
  std::mt19937 random(seed);
  Tracks tracks{.num_cameras = num_cameras, .num_points = 0, .camera = {}, .point = {}};
  for (int p = 0; p < num_points; ++p) {
    const int length =
        p % 10 == 9 ? 1 + static_cast<int>(random() % num_cameras) : static_cast<int>(random() % 5);
    const bool neighbours = random() % 2 == 0;
    const int first = static_cast<int>(random() % num_cameras);
    std::set<int> seen;
    for (int k = 0; k < length; ++k)
      seen.insert(neighbours ? (first + k) % num_cameras
                             : static_cast<int>(random() % num_cameras));
    for (int i : seen) tracks.see(i, p);
  }
  return tracks;
}

using Pairs = std::set<std::pair<int, int>>;

Pairs expected_pairs(const Tracks& tracks, const CameraPairs& extra) {
  Pairs pairs;
  for (int i = 0; i < tracks.num_cameras; ++i) pairs.emplace(i, i);
  for (const auto& [i, j] : extra) pairs.emplace(std::min(i, j), std::max(i, j));
  for (std::size_t a = 0; a < tracks.camera.size(); ++a) {
    for (std::size_t b = a + 1; b < tracks.camera.size() && tracks.point[b] == tracks.point[a]; ++b)
      pairs.emplace(std::minmax(tracks.camera[a], tracks.camera[b]));
  }
  return pairs;
}

std::vector<std::pair<int, int>> listed(const CameraPattern& pattern) {
  std::vector<std::pair<int, int>> blocks;
  for (int i = 0; i < pattern.num_rows(); ++i) {
    for (int j : pattern.columns_of_row(i)) blocks.emplace_back(i, j);
  }
  return blocks;
}

void expect_equal(const CameraPattern& pattern, const Pairs& pairs) {
  EXPECT_EQ(listed(pattern), (std::vector<std::pair<int, int>>(pairs.begin(), pairs.end())));
}

class RandomTracks : public testing::TestWithParam<std::tuple<unsigned, int, int>> {
 protected:
  Tracks tracks =
      random_tracks(std::get<0>(GetParam()), std::get<1>(GetParam()), std::get<2>(GetParam()));
  int last = tracks.num_cameras - 1;
  CameraPairs extra{{last, 0}, {last / 2, last}, {1, 1}};
};

TEST_P(RandomTracks, PatternHoldsExactlyThePairsThatMeet) {
  ThreadPool pool(1);
  expect_equal(make_camera_pattern(tracks.graph(), {}, pool), expected_pairs(tracks, {}));
  expect_equal(make_camera_pattern(tracks.graph(), extra, pool), expected_pairs(tracks, extra));
}

TEST_P(RandomTracks, PatternIsTheSameForEveryNumberOfThreads) {
  ThreadPool one(1), three(3);
  const ObservationGraph graph = tracks.graph();
  EXPECT_EQ(listed(make_camera_pattern(graph, extra, one)),
            listed(make_camera_pattern(graph, extra, three)));
}

TEST_P(RandomTracks, PatternOfPointsCutOverRanksIsThatOfTheWhole) {
  const Pairs expected = expected_pairs(tracks, extra);
  support::play_ranks(3, [&](Exchange& exchange) {
    Tracks part{.num_cameras = tracks.num_cameras, .num_points = 0, .camera = {}, .point = {}};
    for (std::size_t k = 0; k < tracks.camera.size(); ++k) {
      if (tracks.point[k] % 3 == exchange.rank()) part.see(tracks.camera[k], tracks.point[k]);
    }
    ThreadPool pool(1);
    expect_equal(make_global_camera_pattern(part.graph(), extra, pool, exchange), expected);
  });
}

INSTANTIATE_TEST_SUITE_P(Seeds,
                         RandomTracks,
                         testing::Combine(testing::Values(1u, 2u, 3u),
                                          testing::Values(5, 64, 150),
                                          testing::Values(4, 60)));

// Each row is full after its first track.
TEST(CameraPattern, OfPointsThatAllCamerasSeeIsFoundWithoutNamingTheirPairs) {
  Tracks tracks{.num_cameras = 2000, .num_points = 0, .camera = {}, .point = {}};
  for (int p = 0; p < 6; ++p) {
    for (int i = 0; i < 2000; ++i) tracks.see(i, p);
  }
  ThreadPool pool(1);
  EXPECT_EQ(make_camera_pattern(tracks.graph(), {}, pool).num_blocks(), 2000L * 2001 / 2);
}

TEST(CameraPattern, OfCamerasThatSeeNothingIsTheDiagonal) {
  ThreadPool pool(1);
  const ObservationGraph graph = make_observation_graph(70, 3, {}, {});
  EXPECT_EQ(make_camera_pattern(graph, {}, pool).num_blocks(), 70);
  EXPECT_EQ(make_camera_pattern(make_observation_graph(0, 0, {}, {}), {}, pool).num_rows(), 0);
}

}  // namespace
}  // namespace sfmcpp::linear::camera_pattern_test

namespace sfmcpp::linear::reduced_structure_test {

// The predicted cost of the sparse factorisation against the factor that Eigen computes.

namespace {

using Matrix = Eigen::SparseMatrix<double>;

CameraPattern pattern_of(const support::SystemOptions& options) {
  ThreadPool pool(1);
  return make_camera_pattern(make_graph(options), {}, pool);
}

// A positive definite matrix of the graph's pattern, its blocks in elimination order.
Matrix matrix_in_order(const BlockGraph& graph, const std::vector<int>& position) {
  const std::size_t n = graph.size.size();
  std::vector<int> size(n), first(n + 1, 0);
  for (std::size_t k = 0; k < n; ++k) size[position[k]] = graph.size[k];
  for (std::size_t k = 0; k < n; ++k) first[k + 1] = first[k] + size[k];
  std::vector<Eigen::Triplet<double>> entries;
  const auto fill = [&](int a, int b) {
    for (int r = first[a]; r < first[a + 1]; ++r) {
      for (int c = first[b]; c < first[b + 1]; ++c)
        entries.emplace_back(r, c, r == c ? 1e4 : 1.0 / (1 + r + c));
    }
  };
  for (std::size_t k = 0; k < n; ++k) fill(static_cast<int>(k), static_cast<int>(k));
  for (const auto& [a, b] : graph.edges) {
    fill(position[a], position[b]);
    fill(position[b], position[a]);
  }
  Matrix matrix(first[n], first[n]);
  matrix.setFromTriplets(entries.begin(), entries.end());
  return matrix;
}

using Cholesky = Eigen::SimplicialLLT<Matrix, Eigen::Lower, Eigen::NaturalOrdering<int>>;

double factor_entries(const Matrix& matrix) {
  return static_cast<double>(Matrix(Cholesky(matrix).matrixL()).nonZeros());
}

class RandomBlockGraph : public testing::TestWithParam<std::tuple<unsigned, double>> {
 protected:
  BlockGraph graph =
      support::random_block_graph(std::get<0>(GetParam()), 25, std::get<1>(GetParam()));
  BlockOrdering ordering = support::ordered(graph);
};

TEST_P(RandomBlockGraph, PositionsAreAPermutation) {
  const std::set<int> places(ordering.position.begin(), ordering.position.end());
  EXPECT_EQ(places.size(), graph.size.size());
  EXPECT_EQ(*places.rbegin(), static_cast<int>(graph.size.size()) - 1);
}

TEST_P(RandomBlockGraph, PredictedEntriesAreThoseOfTheFactor) {
  EXPECT_EQ(ordering.factor_entries, factor_entries(matrix_in_order(graph, ordering.position)));
}

// Column by column a factorisation takes about h² flops for a column with h entries below the
// diagonal; by blocks of d columns Σ (h + j)² = d h² + d² h + d³/3 up to lower orders.
TEST_P(RandomBlockGraph, PredictedFlopsAreThoseOfTheFactorUpToLowerOrders) {
  const Matrix factor(Cholesky(matrix_in_order(graph, ordering.position)).matrixL());
  double least = 0.0, most = 0.0;
  for (int c = 0; c < factor.cols(); ++c) {
    const double entries = factor.outerIndexPtr()[c + 1] - factor.outerIndexPtr()[c];
    least += (entries - 1) * (entries - 1);
    most += entries * entries;
  }
  EXPECT_GE(ordering.flops, least);
  EXPECT_LE(ordering.flops, most);
}

INSTANTIATE_TEST_SUITE_P(Graphs,
                         RandomBlockGraph,
                         testing::Combine(testing::Values(1u, 2u, 3u),
                                          testing::Values(0.0, 0.08, 0.3, 1.0)));

TEST(OrderBlocks, FillsLessThanTheGivenOrderOnAStar) {
  BlockGraph star;  // the hub first: eliminating it fills everything
  star.size.assign(20, 6);
  for (int k = 1; k < 20; ++k) star.edges.emplace_back(0, k);
  const double hub_last = 20 * 21 + 19 * 36;
  EXPECT_EQ(support::ordered(star).factor_entries, hub_last);
}

TEST(MakeBlockGraph, SharedIntrinsicsAreCoupledWithEveryCameraOfTheGroupAndItsNeighbours) {
  const support::SystemOptions options{
      .cameras = 6, .points = 12, .camera_size = 9, .shared = 3, .groups = 3, .window = 2};
  const BlockGraph graph = make_block_graph(pattern_of(options), make_map(options));
  ASSERT_EQ(graph.size, (std::vector<int>{6, 6, 6, 6, 6, 6, 3, 3, 3}));
  const auto coupled = [&](int a, int b) {
    return std::binary_search(graph.edges.begin(), graph.edges.end(), std::pair(a, b));
  };
  for (int i = 0; i < 6; ++i) {
    EXPECT_EQ(coupled(0, i), i == 1 || i == 5) << i;
    EXPECT_TRUE(coupled(i, 6 + i % 3)) << "its own row of intrinsics";
    EXPECT_TRUE(coupled(i, 6 + (i + 1) % 3)) << "that of a camera with common points";
  }
  EXPECT_TRUE(coupled(6, 7) && coupled(7, 8) && coupled(6, 8));
}

TEST(OrderBlocks, IntrinsicsThatAllCamerasShareComeLast) {
  const support::SystemOptions options{
      .cameras = 300, .points = 600, .camera_size = 9, .shared = 3, .groups = 1, .window = 3};
  ThreadPool pool(1);
  const ReducedStructure structure =
      make_sparse_structure(pattern_of(options), make_map(options), pool);
  EXPECT_EQ(structure.ordering.position.back(), 300);
}

}  // namespace
}  // namespace sfmcpp::linear::reduced_structure_test

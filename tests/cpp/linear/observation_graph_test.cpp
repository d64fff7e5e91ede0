#include "sfmcpp/linear/observation_graph.hpp"

#include <algorithm>
#include <numeric>
#include <random>
#include <set>

#include <gtest/gtest.h>

#include "sfmcpp/linear/reduced_structure.hpp"

namespace sfmcpp::linear::observation_graph_test {
namespace {

struct Observations {
  int num_cameras, num_points;
  std::vector<int> camera, point;
};

// Each pair at most once, in random order; some cameras and points see nothing.
Observations random_observations(unsigned seed,
                                 int num_cameras = 7,
                                 int num_points = 900,
                                 double share = 0.6) {
  std::mt19937 random(seed);
  std::bernoulli_distribution seen(share);
  std::vector<std::pair<int, int>> pairs;
  for (int i = 0; i < num_cameras; ++i) {
    for (int p = 0; p < num_points; ++p) {
      if (i != 3 && p % 50 != 7 && seen(random)) pairs.emplace_back(i, p);
    }
  }
  std::shuffle(pairs.begin(), pairs.end(), random);
  Observations result{num_cameras, num_points, {}, {}};
  for (const auto& [i, p] : pairs) {
    result.camera.push_back(i);
    result.point.push_back(p);
  }
  return result;
}

class RandomGraph : public testing::TestWithParam<unsigned> {
 protected:
  Observations given = random_observations(GetParam());
  ObservationGraph graph =
      make_observation_graph(given.num_cameras, given.num_points, given.camera, given.point);
  int count = graph.num_observations();
};

TEST_P(RandomGraph, IsAPermutationOfWhatWasGiven) {
  ASSERT_EQ(graph.num_observations(), static_cast<int>(given.camera.size()));
  std::set<int> sources(graph.source.begin(), graph.source.end());
  EXPECT_EQ(static_cast<int>(sources.size()), count);
  for (int k = 0; k < count; ++k) {
    EXPECT_EQ(graph.camera[k], given.camera[graph.source[k]]);
    EXPECT_EQ(graph.point[k], given.point[graph.source[k]]);
  }
}

TEST_P(RandomGraph, ObservationsAreStoredByCameraThenByPoint) {
  for (int k = 1; k < count; ++k) {
    EXPECT_LT(std::pair(graph.camera[k - 1], graph.point[k - 1]),
              std::pair(graph.camera[k], graph.point[k]));
  }
  for (int i = 0; i < given.num_cameras; ++i) {
    EXPECT_EQ(graph.observations_of_camera(i),
              std::count(given.camera.begin(), given.camera.end(), i));
    for (int k = graph.camera_begin[i]; k < graph.camera_begin[i + 1]; ++k)
      EXPECT_EQ(graph.camera[k], i);
  }
}

TEST_P(RandomGraph, ListsOfPointsHoldTheirObservationsByAscendingCamera) {
  for (int p = 0; p < given.num_points; ++p) {
    EXPECT_EQ(graph.observations_of_point(p),
              std::count(given.point.begin(), given.point.end(), p));
    for (int k = graph.point_begin[p]; k < graph.point_begin[p + 1]; ++k) {
      EXPECT_EQ(graph.point[graph.of_point[k]], p);
      if (k == graph.point_begin[p]) continue;
      EXPECT_LT(graph.camera[graph.of_point[k - 1]], graph.camera[graph.of_point[k]]);
    }
  }
}

TEST_P(RandomGraph, RankIsThePlaceInTheListOfThePoint) {
  for (int k = 0; k < count; ++k) EXPECT_EQ(graph.of_point[graph.rank[k]], k);
}

TEST_P(RandomGraph, ChunksCoverTheObservationsInOrderOneCameraEach) {
  int next = 0;
  for (const Chunk& chunk : graph.chunks) {
    EXPECT_EQ(chunk.begin, next);
    EXPECT_GT(chunk.end, chunk.begin);
    EXPECT_LE(chunk.end - chunk.begin, kChunkSize);
    for (int k = chunk.begin; k < chunk.end; ++k) EXPECT_EQ(graph.camera[k], chunk.camera);
    next = chunk.end;
  }
  EXPECT_EQ(next, count);
  for (int i = 0; i < given.num_cameras; ++i) {
    for (int c = graph.chunk_begin[i]; c < graph.chunk_begin[i + 1]; ++c)
      EXPECT_EQ(graph.chunks[c].camera, i);
  }
  EXPECT_EQ(graph.chunk_begin.back(), static_cast<int>(graph.chunks.size()));
}

TEST_P(RandomGraph, PointIndicesCanBeReadAPackBeyondTheEnd) {
  ASSERT_GE(graph.point.size(), static_cast<std::size_t>(count) + 8);
  for (std::size_t k = count; k < graph.point.size(); ++k) {
    EXPECT_GE(graph.point[k], 0);
    EXPECT_LT(graph.point[k], given.num_points);
  }
}

// Files mostly have them by point, scenes by camera.
TEST_P(RandomGraph, IsTheSameForEveryOrderInWhichObservationsAreGiven) {
  std::vector<int> order(given.camera.size());
  std::iota(order.begin(), order.end(), 0);
  for (const std::vector<int>& key : {given.point, given.camera}) {
    std::ranges::stable_sort(order, {}, [&](int k) { return key[k]; });
    Observations sorted{given.num_cameras, given.num_points, {}, {}};
    for (int k : order) {
      sorted.camera.push_back(given.camera[k]);
      sorted.point.push_back(given.point[k]);
    }
    const ObservationGraph other =
        make_observation_graph(sorted.num_cameras, sorted.num_points, sorted.camera, sorted.point);
    EXPECT_EQ(other.camera, graph.camera);
    EXPECT_EQ(other.point, graph.point);
    EXPECT_EQ(other.of_point, graph.of_point);
    EXPECT_EQ(other.rank, graph.rank);
    for (int k = 0; k < count; ++k) EXPECT_EQ(sorted.point[other.source[k]], graph.point[k]);
  }
}

TEST_P(RandomGraph, PairUpdatesAreThePairsOfObservationsOfAPointAndTheObservations) {
  double pairs = 0.0;
  for (int a = 0; a < count; ++a) {
    for (int b = a; b < count; ++b) pairs += given.point[a] == given.point[b];
  }
  EXPECT_EQ(num_pair_updates(graph), pairs);
}

INSTANTIATE_TEST_SUITE_P(Seeds, RandomGraph, testing::Values(1u, 2u, 3u));

TEST(ObservationGraph, OfNothingIsEmptyNotBroken) {
  const ObservationGraph graph = make_observation_graph(2, 3, {}, {});
  EXPECT_EQ(graph.num_observations(), 0);
  EXPECT_TRUE(graph.chunks.empty());
  EXPECT_EQ(graph.observations_of_camera(1), 0);
  EXPECT_EQ(graph.observations_of_point(2), 0);
}

}  // namespace
}  // namespace sfmcpp::linear::observation_graph_test

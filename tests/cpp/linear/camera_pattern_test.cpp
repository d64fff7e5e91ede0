// Which cameras meet, against all pairs of cameras tried one by one.
#include "sfmcpp/linear/camera_pattern.hpp"

#include <random>
#include <set>

#include <gtest/gtest.h>

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
    for (long k = pattern.row_begin[i]; k < pattern.row_begin[i + 1]; ++k)
      blocks.emplace_back(i, pattern.column[k]);
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

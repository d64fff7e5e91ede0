// The gap of the walk between cameras, against the eigenvalues of the dense matrix.
#include "sfmcpp/linear/covisibility.hpp"

#include <cmath>
#include <random>
#include <vector>

#include <Eigen/Dense>
#include <gtest/gtest.h>

#include "support/threaded_exchange.hpp"

namespace sfmcpp::linear::covisibility_test {
namespace {

struct Observations {
  int cameras = 0, points = 0;
  std::vector<int> camera, point;

  void add(int i, int p) {
    camera.push_back(i);
    point.push_back(p);
  }
  // Of the points of one of so many ranks; which are numbered anew.
  ObservationGraph graph(int rank = 0, int ranks = 1) const {
    std::vector<int> own_cameras, own_points;
    for (std::size_t k = 0; k < camera.size(); ++k) {
      if (point[k] % ranks != rank) continue;
      own_cameras.push_back(camera[k]);
      own_points.push_back(point[k] / ranks);
    }
    return make_observation_graph(cameras, (points + ranks - 1) / ranks, own_cameras, own_points);
  }
};

// Each point is seen by five cameras, drawn from all, or from as many as `window` in a row.
Observations scene(int cameras, int points, int window, unsigned seed) {
  std::mt19937 random(seed);
  Observations result{.cameras = cameras, .points = points, .camera = {}, .point = {}};
  for (int p = 0; p < points; ++p) {
    const int first = static_cast<int>(random() % (cameras - window + 1));
    std::vector<int> some(window);
    for (int k = 0; k < window; ++k) some[k] = first + k;
    for (int k = 0; k < 5; ++k) {
      std::swap(some[k], some[k + random() % (window - k)]);
      result.add(some[k], p);
    }
  }
  return result;
}

double gap_of_dense_matrix(const Observations& scene) {
  Eigen::MatrixXd seen = Eigen::MatrixXd::Zero(scene.cameras, scene.points);
  for (std::size_t k = 0; k < scene.camera.size(); ++k) seen(scene.camera[k], scene.point[k]) = 1.0;
  const Eigen::VectorXd of_cameras = seen.rowwise().sum(), of_points = seen.colwise().sum();
  const Eigen::MatrixXd walk = of_cameras.cwiseSqrt().cwiseInverse().asDiagonal() * seen *
                               of_points.cwiseInverse().asDiagonal() * seen.transpose() *
                               of_cameras.cwiseSqrt().cwiseInverse().asDiagonal();
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(walk, Eigen::EigenvaluesOnly);
  return 1.0 - solver.eigenvalues()[scene.cameras - 2];
}

TEST(Covisibility, IsOneWhereAllCamerasSeeAllPoints) {
  ThreadPool pool(1);
  Observations all{.cameras = 12, .points = 40, .camera = {}, .point = {}};
  for (int i = 0; i < 12; ++i)
    for (int p = 0; p < 40; ++p) all.add(i, p);
  EXPECT_NEAR(covisibility_gap(all.graph(), pool, this_process(), 0.0), 1.0, 1e-12);
}

TEST(Covisibility, IsThatOfTheDenseMatrixWhereAnyTwoCamerasMayMeet) {
  ThreadPool pool(2);
  for (unsigned seed : {1u, 2u, 3u}) {
    const Observations photos = scene(60, 2000, 60, seed);
    const double gap = covisibility_gap(photos.graph(), pool, this_process(), 0.0);
    const double exact = gap_of_dense_matrix(photos);
    EXPECT_GT(exact, 0.3);
    EXPECT_NEAR(gap, exact, 0.02 * exact);
  }
}

TEST(Covisibility, IsNotBelowThatOfTheDenseMatrixAndSmallAlongAChain) {
  ThreadPool pool(2);
  const Observations chain = scene(60, 2000, 8, 4);
  const double gap = covisibility_gap(chain.graph(), pool, this_process(), 0.0);
  EXPECT_GE(gap, gap_of_dense_matrix(chain) * (1 - 1e-9));
  EXPECT_LT(gap, 0.05);
}

TEST(Covisibility, EndsOnceItIsKnownToBeBelowWhatIsAskedFor) {
  ThreadPool pool(2);
  const Observations chain = scene(60, 2000, 8, 5);
  const double whole = covisibility_gap(chain.graph(), pool, this_process(), 0.0);
  const double early = covisibility_gap(chain.graph(), pool, this_process(), 0.5);
  EXPECT_LT(early, 0.5);
  EXPECT_GT(early, whole);
}

TEST(Covisibility, LeavesOutWhatSeesNothing) {
  ThreadPool pool(2);
  Observations photos = scene(60, 2000, 60, 6);
  const double gap = covisibility_gap(photos.graph(), pool, this_process(), 0.0);
  photos.cameras += 1;
  photos.points += 3;
  EXPECT_NEAR(covisibility_gap(photos.graph(), pool, this_process(), 0.0), gap, 0.02 * gap);
}

TEST(Covisibility, OfNoOrOneCameraIsOne) {
  ThreadPool pool(2);
  Observations few{.cameras = 0, .points = 0, .camera = {}, .point = {}};
  EXPECT_EQ(covisibility_gap(few.graph(), pool, this_process(), 0.0), 1.0);
  few = {.cameras = 1, .points = 2, .camera = {0, 0}, .point = {0, 1}};
  EXPECT_EQ(covisibility_gap(few.graph(), pool, this_process(), 0.0), 1.0);
}

TEST(Covisibility, HasTheSameBitsForEveryNumberOfRanksAndThreads) {
  ThreadPool pool(1);
  for (int window : {60, 8}) {
    const Observations all = scene(60, 2000, window, 7);
    const double alone = covisibility_gap(all.graph(), pool, this_process(), 0.01);
    ThreadPool three(3);
    EXPECT_EQ(covisibility_gap(all.graph(), three, this_process(), 0.01), alone);
    for (int ranks : {2, 3}) {
      std::vector<double> gaps(ranks);
      support::play_ranks(ranks, [&](Exchange& exchange) {
        ThreadPool of_rank(1);
        ObservationGraph graph = all.graph(exchange.rank(), ranks);
        exchange.sum(graph.of_camera_on_all_ranks);
        gaps[exchange.rank()] = covisibility_gap(graph, of_rank, exchange, 0.01);
      });
      for (double gap : gaps) EXPECT_EQ(gap, alone);
    }
  }
}

}  // namespace
}  // namespace sfmcpp::linear::covisibility_test

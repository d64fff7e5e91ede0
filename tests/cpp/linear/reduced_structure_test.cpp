// The predicted cost of the sparse factorisation against the factor that Eigen computes.
#include "sfmcpp/linear/reduced_structure.hpp"

#include <algorithm>
#include <set>

#include <Eigen/SparseCholesky>
#include <gtest/gtest.h>

#include "support/random_blocks.hpp"
#include "support/random_system.hpp"

namespace sfmcpp::linear::reduced_structure_test {
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
  BlockOrdering ordering = order_blocks(graph);
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
  EXPECT_EQ(order_blocks(star).factor_entries, hub_last);
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
  const ReducedStructure structure = make_sparse_structure(pattern_of(options), make_map(options));
  EXPECT_EQ(structure.ordering.position.back(), 300);
}

}  // namespace
}  // namespace sfmcpp::linear::reduced_structure_test

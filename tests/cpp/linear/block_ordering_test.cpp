// Orders by nested dissection: separators that separate, and less fill than minimum degree where
// that is known.
#include "sfmcpp/linear/block_ordering.hpp"

#include <algorithm>
#include <numeric>

#include <gtest/gtest.h>

#include "sfmcpp/linear/vertex_separator.hpp"
#include "support/random_blocks.hpp"

namespace sfmcpp::linear::nested_dissection_test {
namespace {

WeightedGraph weighted(const BlockGraph& graph) {
  const Adjacency adjacency = make_adjacency(graph);
  WeightedGraph result;
  for (int node = 0; node < adjacency.num_nodes(); ++node) {
    for (int neighbour : adjacency.of(node)) {
      result.neighbour.push_back(neighbour);
      result.edge_weight.push_back(1);
    }
    result.weight.push_back(graph.size[node]);
    result.begin.push_back(static_cast<std::int64_t>(result.neighbour.size()));
  }
  return result;
}

// A square whose nodes meet all others at most two steps away.
BlockGraph thick_grid(int side) {
  BlockGraph graph{.size = std::vector<int>(side * side, 9), .edges = {}};
  for (int a = 0; a < side * side; ++a) {
    for (int b = a + 1; b < side * side; ++b) {
      if (std::abs(a / side - b / side) <= 2 && std::abs(a % side - b % side) <= 2)
        graph.edges.emplace_back(a, b);
    }
  }
  return graph;
}

class Graphs : public testing::TestWithParam<int> {
 protected:
  static BlockGraph graph() {
    switch (GetParam()) {
      case 0:
        return support::grid_graph(40, 6);
      case 1:
        return support::grid_graph(30, 6, true);
      case 2:
        return support::random_block_graph(3, 500, 0.01);
      case 3:
        return support::random_block_graph(4, 400, 0.0);
      case 4:
        return support::random_block_graph(5, 300, 0.5);
      default:
        return thick_grid(30);
    }
  }
};

TEST_P(Graphs, SeparatorsLeaveNoNeighboursOnBothSides) {
  const WeightedGraph graph = weighted(Graphs::graph());
  const std::vector<Side> side = find_separator(graph);
  ASSERT_EQ(static_cast<int>(side.size()), graph.num_nodes());
  for (int node = 0; node < graph.num_nodes(); ++node) {
    if (side[node] != kLeft) continue;
    for (int neighbour : graph.of(node)) EXPECT_NE(side[neighbour], kRight);
  }
}

TEST_P(Graphs, AnOrderHasEveryBlockOnceAndIsTheSameForAnyNumberOfThreads) {
  const BlockGraph graph = Graphs::graph();
  const Adjacency adjacency = make_adjacency(graph);
  ThreadPool one(1), three(3);
  std::vector<int> order = nested_dissection(graph, adjacency, one);
  EXPECT_EQ(order, nested_dissection(graph, adjacency, three));
  std::sort(order.begin(), order.end());
  std::vector<int> all(graph.size.size());
  std::iota(all.begin(), all.end(), 0);
  EXPECT_EQ(order, all);
}

INSTANTIATE_TEST_SUITE_P(All, Graphs, testing::Range(0, 6));

// A line of one side's length cuts a square grid in two; no set of nodes that leaves three tenths
// on either side is much smaller.
TEST(FindSeparator, OfAGridIsAboutAsLongAsItsSide) {
  const BlockGraph graph = support::grid_graph(40, 1);
  const std::vector<Side> side = find_separator(weighted(graph));
  EXPECT_LE(std::ranges::count(side, kSeparator), 48);
  EXPECT_GE(std::ranges::count(side, kLeft), 480);
  EXPECT_GE(std::ranges::count(side, kRight), 480);
}

TEST(NestedDissection, PutsABlockThatAllMeetLast) {
  const BlockGraph graph = support::grid_graph(40, 6, true);
  ThreadPool pool(2);
  EXPECT_EQ(nested_dissection(graph, make_adjacency(graph), pool).back(), 1600);
}

// On a large regular grid minimum degree is known to lose.
TEST(OrderBlocks, TakesNestedDissectionWhereItHasFewerFlops) {
  const BlockGraph graph = thick_grid(70);
  const BlockOrdering best = support::ordered(graph);
  const std::vector<int> order = minimum_degree(make_adjacency(graph));
  EXPECT_LT(best.flops, 0.9 * predict(graph, make_adjacency(graph), order).flops);
}

}  // namespace
}  // namespace sfmcpp::linear::nested_dissection_test

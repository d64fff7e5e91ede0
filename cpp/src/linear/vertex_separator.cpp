#include "sfmcpp/linear/vertex_separator.hpp"

#include <algorithm>
#include <numeric>

#include "separator_refinement.hpp"

namespace sfmcpp::linear {
namespace {

constexpr int kCoarsest = 120;        // nodes
constexpr double kLeastShrink = 0.9;  // of a level; beyond, pairs are no longer found
constexpr int kRegions = 8;           // grown on the coarsest graph
// Shares of the weight that the larger side may have. Each makes a separator of its own: now one,
// now the other is far better.
constexpr double kLargestSides[] = {0.52, 0.55, 0.6};

// Light nodes of low degree first: they have the fewest partners. The coarse node of each node.
std::vector<int> match_pairs(const WeightedGraph& graph, int& num_pairs) {
  const int n = graph.num_nodes();
  std::vector<int> order(n), partner(n, kNone), coarse(n);
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(), [&](int a, int b) {
    return graph.of(a).size() < graph.of(b).size();
  });
  const long total = std::accumulate(graph.weight.begin(), graph.weight.end(), 0L);
  const long heaviest = std::max(total / (kCoarsest / 4), 1L);
  for (int node : order) {
    if (partner[node] != kNone) continue;
    int best = node, best_weight = 0;
    for (std::int64_t k = graph.begin[node]; k < graph.begin[node + 1]; ++k) {
      const int v = graph.neighbour[k];
      const bool fits = partner[v] == kNone && graph.weight[node] + graph.weight[v] <= heaviest;
      if (!fits || graph.edge_weight[k] <= best_weight) continue;
      best = v;
      best_weight = graph.edge_weight[k];
    }
    partner[node] = best;
    partner[best] = node;
  }
  num_pairs = 0;
  for (int node = 0; node < n; ++node)
    coarse[node] = partner[node] < node ? coarse[partner[node]] : num_pairs++;
  return coarse;
}

WeightedGraph contract(const WeightedGraph& graph, const std::vector<int>& coarse, int nodes) {
  WeightedGraph result;
  result.weight.assign(nodes, 0);
  std::vector<int> first(nodes, kNone), second(nodes, kNone);
  for (int node = 0; node < graph.num_nodes(); ++node) {
    result.weight[coarse[node]] += graph.weight[node];
    (first[coarse[node]] == kNone ? first : second)[coarse[node]] = node;
  }
  std::vector<std::int64_t> place(nodes, kNone);  // of each neighbour in the row being made
  result.neighbour.reserve(graph.neighbour.size());
  result.edge_weight.reserve(graph.neighbour.size());
  for (int c = 0; c < nodes; ++c) {
    const std::int64_t begin = result.begin.back();
    for (int node : {first[c], second[c]}) {
      if (node == kNone) continue;
      for (std::int64_t k = graph.begin[node]; k < graph.begin[node + 1]; ++k) {
        const int v = coarse[graph.neighbour[k]];
        if (v == c) continue;
        if (place[v] < begin) {
          place[v] = static_cast<std::int64_t>(result.neighbour.size());
          result.neighbour.push_back(v);
          result.edge_weight.push_back(0);
        }
        result.edge_weight[place[v]] += graph.edge_weight[k];
      }
    }
    result.begin.push_back(static_cast<std::int64_t>(result.neighbour.size()));
  }
  return result;
}

// Nodes in the order in which a search by breadth meets them; unconnected ones last.
std::vector<int> by_breadth(const WeightedGraph& graph, int start) {
  std::vector<int> order{start};
  std::vector<char> seen(graph.num_nodes(), 0);
  seen[start] = 1;
  for (std::size_t k = 0; k < order.size(); ++k) {
    for (int v : graph.of(order[k])) {
      if (seen[v]) continue;
      seen[v] = 1;
      order.push_back(v);
    }
  }
  for (int node = 0; node < graph.num_nodes(); ++node) {
    if (!seen[node]) order.push_back(node);
  }
  return order;
}

// Half of the weight is left, the border of the right half the separator.
std::vector<Side> grow(const WeightedGraph& graph, int start, double largest_side) {
  std::vector<Side> side(graph.num_nodes(), kRight);
  const long total = std::accumulate(graph.weight.begin(), graph.weight.end(), 0L);
  long left = 0;
  for (int node : by_breadth(graph, start)) {
    if (2 * left >= total) break;
    left += graph.weight[node];
    side[node] = kLeft;
  }
  for (int node = 0; node < graph.num_nodes(); ++node) {
    if (side[node] != kRight) continue;
    if (std::ranges::any_of(graph.of(node), [&](int v) { return side[v] == kLeft; }))
      side[node] = kSeparator;
  }
  refine_separator(graph, side, largest_side);
  return side;
}

std::vector<Side> cut_coarsest(const WeightedGraph& graph, double largest_side) {
  std::vector<Side> best;
  double best_cost = 0.0;
  int start = by_breadth(graph, 0).back();
  for (int k = 0; k < kRegions; ++k) {
    std::vector<Side> side = grow(graph, start, largest_side);
    const double cost = weigh(graph, side).cost();
    if (best.empty() || cost < best_cost) {
      best = std::move(side);
      best_cost = cost;
    }
    // The far end of the graph first, then starts spread over it.
    start = k == 0 ? by_breadth(graph, start).back() : k * graph.num_nodes() / kRegions;
  }
  return best;
}

// One for each of kLargestSides.
std::vector<std::vector<Side>> separators(const WeightedGraph& graph) {
  std::vector<std::vector<Side>> found;
  int nodes = graph.num_nodes();
  std::vector<int> coarse;
  if (nodes > kCoarsest) coarse = match_pairs(graph, nodes);
  if (nodes > kLeastShrink * graph.num_nodes()) {
    for (double largest : kLargestSides) found.push_back(cut_coarsest(graph, largest));
    return found;
  }
  const auto coarse_sides = separators(contract(graph, coarse, nodes));
  for (std::size_t k = 0; k < coarse_sides.size(); ++k) {
    std::vector<Side>& side = found.emplace_back(graph.num_nodes());
    for (int node = 0; node < graph.num_nodes(); ++node) side[node] = coarse_sides[k][coarse[node]];
    refine_separator(graph, side, kLargestSides[k]);
  }
  return found;
}

}  // namespace

std::vector<Side> find_separator(const WeightedGraph& graph) {
  std::vector<std::vector<Side>> found = separators(graph);
  return std::move(*std::ranges::min_element(
      found, {}, [&](const std::vector<Side>& side) { return weigh(graph, side).cost(); }));
}

}  // namespace sfmcpp::linear

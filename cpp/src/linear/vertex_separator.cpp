#include "sfmcpp/linear/vertex_separator.hpp"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <iterator>
#include <numeric>
#include <queue>
#include <vector>

namespace sfmcpp::linear {
namespace {

// The constants below were varied one at a time. Beside other values stands what they multiply the
// flops of a Cholesky factorisation by, in the order of nested dissection, on ten graphs: cities of
// 500 to 8,000 cameras, a corridor and loops of 1,000, grids of streets of 3,000 and 6,000. From
// 0.9 to 1.1 they are equally good: which is better depends on the graph.

// Weights of the left side, the right side, and the separator.
struct CutWeights {
  long of[3] = {0, 0, 0};

  long total() const { return of[0] + of[1] + of[2]; }
  // Small separators first; parts that differ much cost extra.
  double cost() const {
    const double all = static_cast<double>(total());
    const double difference = static_cast<double>(std::abs(of[0] - of[1])) / all;
    return static_cast<double>(of[2]) * (1.0 + difference * difference);
  }
};

CutWeights weigh(const WeightedGraph& graph, const std::vector<Side>& side) {
  CutWeights weights;
  for (int node = 0; node < graph.num_nodes(); ++node) weights.of[side[node]] += graph.weight[node];
  return weights;
}

constexpr int kPasses = 4;  // 1: 0.94 to 1.35; 2: 0.90 to 1.17; 8: 0.95 to 1.04
// Moves without a new best before a pass ends. 1: 0.95 to 1.94; 10: 0.99 to 1.10; 50: 0.94 to 1.05;
// 200: 0.94 to 1.12.
constexpr int kMovesUphill = 25;

Side other(Side side) { return side == kLeft ? kRight : kLeft; }

// One pass: nodes of the separator go to a side, and draw their neighbours on the other side into
// the separator. Every node leaves it once. The best state on the way is kept.
class Pass {
 public:
  Pass(const WeightedGraph& graph, std::vector<Side>& side, double largest_side)
      : graph_(graph),
        side_(side),
        weights_(weigh(graph, side)),
        largest_(static_cast<long>(largest_side * static_cast<double>(weights_.total()))),
        locked_(side.size(), 0),
        gain_{std::vector<long>(side.size()), std::vector<long>(side.size())} {}

  bool improves() {
    for (int node = 0; node < graph_.num_nodes(); ++node) {
      if (side_[node] == kSeparator) enter(node);
    }
    const double before = weights_.cost();
    double best = before;
    std::size_t best_length = 0;
    for (int uphill = 0; uphill < kMovesUphill && move_one(); ++uphill) {
      if (weights_.cost() >= best) continue;
      best = weights_.cost();
      best_length = log_.size();
      uphill = -1;
    }
    for (; log_.size() > best_length; log_.pop_back()) side_[log_.back().node] = log_.back().was;
    return best < before;
  }

 private:
  struct Move {
    long gain;
    int node;
    Side to;
    bool operator<(const Move& b) const {
      if (gain != b.gain) return gain < b.gain;
      return node != b.node ? node > b.node : to > b.to;
    }
  };
  struct Change {
    int node;
    Side was;
  };

  // Weight that the separator loses if the node goes to a side.
  long gain_of(int node, Side to) const {
    long gain = graph_.weight[node];
    for (int v : graph_.of(node)) {
      if (side_[v] == other(to)) gain -= graph_.weight[v];
    }
    return gain;
  }
  void enter(int node) {
    for (Side to : {kLeft, kRight}) {
      gain_[to][node] = gain_of(node, to);
      push(node, to);
    }
  }
  void push(int node, Side to) {
    if (!locked_[node]) moves_.push({gain_[to][node], node, to});
  }

  // A gain that has grown was pushed again; one that has fallen is found out here.
  bool move_one() {
    while (!moves_.empty()) {
      const Move move = moves_.top();
      moves_.pop();
      if (side_[move.node] != kSeparator || locked_[move.node]) continue;
      if (gain_[move.to][move.node] != move.gain) {
        if (gain_[move.to][move.node] < move.gain) push(move.node, move.to);
        continue;
      }
      if (weights_.of[move.to] + graph_.weight[move.node] > largest_) continue;
      apply(move);
      return true;
    }
    return false;
  }

  void apply(const Move& move) {
    locked_[move.node] = 1;
    set_side(move.node, move.to);
    for (int v : graph_.of(move.node)) {
      if (side_[v] == other(move.to)) {
        draw_in(v, move.to);
      } else if (side_[v] == kSeparator) {
        // To go to the other side it would now draw this node back.
        gain_[other(move.to)][v] -= graph_.weight[move.node];
      }
    }
  }
  // Nodes of the separator no longer draw this one in when they go to that side.
  void draw_in(int node, Side to) {
    for (int v : graph_.of(node)) {
      if (side_[v] != kSeparator) continue;
      gain_[to][v] += graph_.weight[node];
      push(v, to);
    }
    set_side(node, kSeparator);
    enter(node);
  }
  void set_side(int node, Side to) {
    log_.push_back({node, side_[node]});
    weights_.of[side_[node]] -= graph_.weight[node];
    weights_.of[to] += graph_.weight[node];
    side_[node] = to;
  }

  const WeightedGraph& graph_;
  std::vector<Side>& side_;
  CutWeights weights_;
  long largest_;
  std::vector<char> locked_;
  std::vector<long> gain_[2];
  std::priority_queue<Move> moves_;
  std::vector<Change> log_;
};

// Moves nodes out of the separator while that makes it lighter, past small hills. `largest_side`:
// the share of the weight that a side may have.
void refine_separator(const WeightedGraph& graph, std::vector<Side>& side, double largest_side) {
  for (int pass = 0; pass < kPasses && Pass(graph, side, largest_side).improves(); ++pass) {
  }
}

// Nodes of the coarsest graph. 30: 0.92 to 1.12; 60: 0.90 to 1.13; 240: 0.88 to 1.08.
constexpr int kCoarsest = 120;
// A level with more nodes than this share of the level below is not made: few nodes found partners.
// From 0.8 to 0.97: the same orders.
constexpr double kLeastShrink = 0.9;
// A pair of nodes may have this part of the weight of all, so that the coarsest graph can still be
// cut in half. From 15 to 60: the same orders; 120: 0.88 to 1.43.
constexpr int kLeastPairs = 30;
// Regions grown on the coarsest graph. 1: 0.95 to 1.18; 4: 0.97 to 1.13; 16: 0.87 to 1.04.
constexpr int kRegions = 8;
// Shares of the weight that the larger side may have. Each makes a separator of its own, and the
// best is taken. Only the first: 1.00 to 1.32; the second: 1.00 to 1.50; the third: 1.00 to 1.40;
// 0.67 as well: 0.91 to 1.03.
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
  const long heaviest = std::max(total / kLeastPairs, 1L);
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

// One for each of kLargestSides, side by side where there is a pool.
using Candidates = std::array<std::vector<Side>, std::size(kLargestSides)>;

template <class F>
void for_each_candidate(ThreadPool* pool, const F& f) {
  constexpr int kCount = static_cast<int>(std::size(kLargestSides));
  if (pool != nullptr) return pool->parallel_for(kCount, f);
  for (int k = 0; k < kCount; ++k) f(k);
}

Candidates separators(const WeightedGraph& graph, ThreadPool* pool) {
  Candidates found;
  int nodes = graph.num_nodes();
  std::vector<int> coarse;
  if (nodes > kCoarsest) coarse = match_pairs(graph, nodes);
  if (nodes > kLeastShrink * graph.num_nodes()) {
    for_each_candidate(pool, [&](int k) { found[k] = cut_coarsest(graph, kLargestSides[k]); });
    return found;
  }
  const Candidates of_coarse = separators(contract(graph, coarse, nodes), pool);
  for_each_candidate(pool, [&](int k) {
    found[k].resize(coarse.size());
    for (std::size_t node = 0; node < coarse.size(); ++node)
      found[k][node] = of_coarse[k][coarse[node]];
    refine_separator(graph, found[k], kLargestSides[k]);
  });
  return found;
}

}  // namespace

std::vector<Side> find_separator(const WeightedGraph& graph, ThreadPool* pool) {
  Candidates found = separators(graph, pool);
  return std::move(*std::ranges::min_element(
      found, {}, [&](const std::vector<Side>& side) { return weigh(graph, side).cost(); }));
}

}  // namespace sfmcpp::linear

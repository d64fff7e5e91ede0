#include "separator_refinement.hpp"

#include <algorithm>
#include <cstdlib>
#include <queue>

namespace sfmcpp::linear {
namespace {

constexpr int kPasses = 4;
constexpr int kMovesUphill = 25;  // without a new best, before a pass ends

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

}  // namespace

double CutWeights::cost() const {
  const double all = static_cast<double>(total());
  const double difference = static_cast<double>(std::abs(of[0] - of[1])) / all;
  return static_cast<double>(of[2]) * (1.0 + difference * difference);
}

CutWeights weigh(const WeightedGraph& graph, const std::vector<Side>& side) {
  CutWeights weights;
  for (int node = 0; node < graph.num_nodes(); ++node) weights.of[side[node]] += graph.weight[node];
  return weights;
}

void refine_separator(const WeightedGraph& graph, std::vector<Side>& side, double largest_side) {
  for (int pass = 0; pass < kPasses && Pass(graph, side, largest_side).improves(); ++pass) {
  }
}

}  // namespace sfmcpp::linear

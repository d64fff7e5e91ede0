#include "sfmcpp/linear/block_ordering.hpp"

#include <algorithm>
#include <cmath>

#include <Eigen/OrderingMethods>
#include <Eigen/SparseCore>

#include "sfmcpp/linear/elimination_tree.hpp"
#include "sfmcpp/linear/vertex_separator.hpp"

namespace sfmcpp::linear {
namespace {

// A part with so few blocks is not cut further. On the graphs of vertex_separator.cpp, 50 and 100
// multiply the flops by 0.96 to 1.16, 200 by 0.98 to 1.01, 300 by 0.83 to 1.06.
constexpr int kLeaf = 150;
// A part is not cut where the separator takes more than this share of its nodes. From 0.3 to 0.6:
// the same orders there; 0.2: flops 0.99 to 1.07.
constexpr double kLargestShare = 0.4;

// A symmetric pattern by columns, under construction.
class Pattern {
 public:
  void add(int row) { rows_.push_back(row); }
  // Eigen takes columns without a diagonal for dense ones.
  void end_column() {
    rows_.push_back(static_cast<int>(begin_.size()) - 1);
    begin_.push_back(static_cast<int>(rows_.size()));
  }

  std::vector<int> minimum_degree() {
    using Matrix = Eigen::SparseMatrix<char, Eigen::ColMajor, int>;
    const auto n = static_cast<Eigen::Index>(begin_.size()) - 1;
    const auto entries = static_cast<Eigen::Index>(rows_.size());
    // Rows are in no order, which Eigen's own assignment would ask for.
    Matrix matrix(n, n);
    matrix.resizeNonZeros(entries);
    std::copy(begin_.begin(), begin_.end(), matrix.outerIndexPtr());
    std::copy(rows_.begin(), rows_.end(), matrix.innerIndexPtr());
    std::fill_n(matrix.valuePtr(), entries, 1);
    Eigen::PermutationMatrix<Eigen::Dynamic, Eigen::Dynamic, int> permutation;
    Eigen::internal::minimum_degree_ordering(matrix, permutation);
    return {permutation.indices().begin(), permutation.indices().end()};
  }

 private:
  std::vector<int> begin_{0};
  std::vector<int> rows_;
};

// A part of a graph and the nodes of the whole that its nodes are.
struct Part {
  WeightedGraph graph;
  std::vector<int> node;
};

// Cuts a part after the other: all those of a level of the tree of parts at the same time.
class Dissection {
 public:
  Dissection(const Adjacency& adjacency, ThreadPool& pool)
      : adjacency_(adjacency), pool_(pool), scratch_(pool.num_threads()) {
    for (Scratch& scratch : scratch_)
      for (std::vector<int>* numbers : {&scratch.place, &scratch.number})
        numbers->assign(adjacency.num_nodes(), kNone);
  }

  std::vector<int> order(Part whole) {
    tree_.emplace_back().part = std::move(whole);
    for (std::size_t begin = 0; begin < tree_.size();) {
      const std::size_t end = tree_.size();
      if (end - begin == 1) {
        dissect(tree_[begin], scratch_[0], &pool_);
      } else {
        pool_.parallel_for_worker(static_cast<int>(end - begin), [&](int k, int worker) {
          dissect(tree_[begin + k], scratch_[worker], nullptr);
        });
      }
      for (; begin < end; ++begin) add_halves(begin);
    }
    std::vector<int> order;
    append(0, order);
    return order;
  }

 private:
  // What is left to order of a part, or has been.
  struct Node {
    Part part{};
    Part halves[2]{};
    std::size_t first_half = 0;  // its place in the tree, and the other half follows; 0: a leaf
    std::vector<int> last{};     // the separator, or all of a leaf
  };
  // Of each thread, for nodes of the whole graph.
  struct Scratch {
    std::vector<int> place;   // within the leaf being ordered
    std::vector<int> number;  // within the part being taken
  };

  void add_halves(std::size_t k) {
    if (tree_[k].halves[0].node.empty()) return;
    tree_[k].first_half = tree_.size();
    for (int half : {0, 1}) {
      Part part = std::move(tree_[k].halves[half]);
      tree_.emplace_back().part = std::move(part);
    }
  }

  void append(std::size_t k, std::vector<int>& order) const {
    const Node& node = tree_[k];
    for (std::size_t half = 0; node.first_half != 0 && half < 2; ++half)
      append(node.first_half + half, order);
    order.insert(order.end(), node.last.begin(), node.last.end());
  }

  void dissect(Node& node, Scratch& scratch, ThreadPool* pool) const {
    const Part part = std::move(node.part);
    node.part = {};
    if (part.graph.num_nodes() <= kLeaf) return order_leaf(part, scratch.place, node.last);
    const std::vector<Side> side = find_separator(part.graph, pool);
    const auto share = [&](Side s) {
      return static_cast<double>(std::ranges::count(side, s)) / part.graph.num_nodes();
    };
    if (share(kLeft) == 0 || share(kRight) == 0 || share(kSeparator) > kLargestShare)
      return order_leaf(part, scratch.place, node.last);
    for (Side half : {kLeft, kRight}) node.halves[half] = take(part, side, half, scratch.number);
    // Nothing is gained within it: it fills.
    node.last = take(part, side, kSeparator, scratch.number).node;
  }

  // By minimum degree, with the nodes around that come later: they meet one another.
  void order_leaf(const Part& part, std::vector<int>& place, std::vector<int>& order) const {
    const int n = part.graph.num_nodes();
    for (int k = 0; k < n; ++k) place[part.node[k]] = k;
    std::vector<int> around;
    std::vector<std::vector<int>> met;  // nodes of the part, by each node around
    Pattern pattern;
    for (int k = 0; k < n; ++k) {
      for (int v : adjacency_.of(part.node[k])) {
        if (place[v] == kNone) {
          place[v] = n + static_cast<int>(around.size());
          around.push_back(v);
          met.emplace_back();
        }
        if (place[v] >= n) met[place[v] - n].push_back(k);
        pattern.add(place[v]);
      }
      pattern.end_column();
    }
    for (int a = 0; a < static_cast<int>(around.size()); ++a) {
      for (int node : met[a]) pattern.add(node);
      for (int b = 0; b < static_cast<int>(around.size()); ++b) {
        if (a != b) pattern.add(n + b);
      }
      pattern.end_column();
    }
    for (int node : pattern.minimum_degree()) {
      if (node < n) order.push_back(part.node[node]);
    }
    for (int node : part.node) place[node] = kNone;
    for (int node : around) place[node] = kNone;
  }

  static Part take(const Part& whole,
                   const std::vector<Side>& side,
                   Side wanted,
                   std::vector<int>& number) {
    Part part;
    for (int node = 0; node < whole.graph.num_nodes(); ++node) {
      if (side[node] != wanted) continue;
      number[node] = static_cast<int>(part.node.size());
      part.node.push_back(node);
    }
    for (int& node : part.node) {
      part.graph.weight.push_back(whole.graph.weight[node]);
      for (std::int64_t k = whole.graph.begin[node]; k < whole.graph.begin[node + 1]; ++k) {
        const int v = whole.graph.neighbour[k];
        if (side[v] != wanted) continue;
        part.graph.neighbour.push_back(number[v]);
        part.graph.edge_weight.push_back(whole.graph.edge_weight[k]);
      }
      part.graph.begin.push_back(static_cast<std::int64_t>(part.graph.neighbour.size()));
      node = whole.node[node];
    }
    return part;
  }

  const Adjacency& adjacency_;
  ThreadPool& pool_;
  std::vector<Node> tree_;  // of parts
  std::vector<Scratch> scratch_;
};

// The rule by which approximate minimum degree puts dense rows last (Amestoy, Davis & Duff 2004).
// In graphs of fewer than a hundred nodes no row is.
bool is_dense(std::size_t neighbours, int nodes) {
  constexpr double kDense = 10.0, kLeastDense = 100.0;
  return static_cast<double>(neighbours) > std::max(kLeastDense, kDense * std::sqrt(nodes));
}

}  // namespace

std::vector<int> minimum_degree(const Adjacency& adjacency) {
  Pattern pattern;
  for (int k = 0; k < adjacency.num_nodes(); ++k) {
    for (int v : adjacency.of(k)) pattern.add(v);
    pattern.end_column();
  }
  return pattern.minimum_degree();
}

std::vector<int> nested_dissection(const BlockGraph& graph,
                                   const Adjacency& adjacency,
                                   ThreadPool& pool) {
  const int n = adjacency.num_nodes();
  std::vector<int> number(n, kNone), dense;
  Part part;
  for (int block = 0; block < n; ++block) {
    if (is_dense(adjacency.of(block).size(), n)) {
      dense.push_back(block);
    } else {
      number[block] = static_cast<int>(part.node.size());
      part.node.push_back(block);
    }
  }
  for (int block : part.node) {
    part.graph.weight.push_back(graph.size[block]);
    for (int neighbour : adjacency.of(block)) {
      if (number[neighbour] == kNone) continue;
      part.graph.neighbour.push_back(number[neighbour]);
      part.graph.edge_weight.push_back(1);
    }
    part.graph.begin.push_back(static_cast<std::int64_t>(part.graph.neighbour.size()));
  }
  std::vector<int> order = Dissection(adjacency, pool).order(std::move(part));
  order.insert(order.end(), dense.begin(), dense.end());
  return order;
}

namespace {

// Flops of one factorisation for each coupled pair. Dissection takes about 1 µs a pair and saves a
// quarter of the flops, if any: below, it does not come back in a few steps.
constexpr double kWorthDissecting = 1e5;

}  // namespace

BlockOrdering predict(const BlockGraph& graph,
                      const Adjacency& adjacency,
                      std::vector<int> block_at) {
  BlockOrdering ordering{.position = inverse_permutation(block_at)};
  EliminationTree tree = make_elimination_tree(adjacency, block_at, ordering.position);
  std::vector<int> order = postorder(tree.parent);
  const std::vector<int> place = inverse_permutation(order);
  EliminationTree renumbered{.parent = std::vector<int>(order.size(), kRoot)};
  for (std::size_t k = 0; k < order.size(); ++k) {
    const int parent = tree.parent[order[k]];
    if (parent != kRoot) renumbered.parent[k] = place[parent];
    order[k] = block_at[order[k]];
  }
  ordering.position = inverse_permutation(order);
  const std::vector<std::int64_t> heights =
      column_heights(graph, adjacency, renumbered, order, ordering.position);
  for (std::size_t k = 0; k < order.size(); ++k) {
    const double d = graph.size[order[k]], h = static_cast<double>(heights[k]) - d;
    ordering.flops += d * d * d / 3 + d * d * h + d * h * h;
    ordering.factor_entries += d * (d + 1) / 2 + d * h;
  }
  ordering.factor_bytes = sizeof(double) * ordering.factor_entries;
  return ordering;
}

BlockOrdering order_blocks(const BlockGraph& graph, ThreadPool& pool) {
  if (graph.size.empty()) return {};
  const Adjacency adjacency = make_adjacency(graph);
  BlockOrdering best = predict(graph, adjacency, minimum_degree(adjacency));
  if (best.flops < kWorthDissecting * static_cast<double>(graph.edges.size())) return best;
  BlockOrdering dissected = predict(graph, adjacency, nested_dissection(graph, adjacency, pool));
  return dissected.flops < best.flops ? dissected : best;
}

}  // namespace sfmcpp::linear

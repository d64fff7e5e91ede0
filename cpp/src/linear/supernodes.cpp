#include "sfmcpp/linear/supernodes.hpp"

#include <algorithm>
#include <numeric>

#include "sfmcpp/linear/cholesky_kernels.hpp"
#include "sfmcpp/linear/elimination_tree.hpp"
#include "sfmcpp/linear/panel_cholesky.hpp"

namespace sfmcpp::linear {
namespace {

double flops_of(double columns, double height) {
  return columns * columns * (columns / 3 + height) + columns * height * height;
}

// Time of a supernode, in flops at full rate: products below the panel run at that rate, the panel
// itself at a third of it; every entry of the update is added somewhere else, every entry of the
// panel is touched.
//
// On the graphs of vertex_separator.cpp, the entries of the panel at 20 to 200 flops, and a
// supernode at 3e4 to 3e5, change the flops with zeros by less than 1 %. What an entry of the
// update costs decides: at 10 flops, 0.83 to 1.00 times the flops in up to twice as many
// supernodes; at 100, 1.01 to 1.40 times in down to half as many. A panel at full rate is like the
// latter, at a sixth of it like the former.
double cost_of(std::int64_t columns, std::int64_t height) {
  constexpr double kPanelFlop = 3, kPerUpdate = 30, kPerEntry = 60, kPerSupernode = 1e5;
  const auto n = static_cast<double>(round_up(columns, kPanel));
  const auto h = static_cast<double>(round_up(height, kStrip));
  return kPanelFlop * n * n * (n / 3 + h) + n * h * h + kPerUpdate * h * h +
         kPerEntry * n * (n + h) + kPerSupernode;
}

// Supernodes under construction: one that is joined with its parent stays in the list, marked.
class Amalgamation {
 public:
  Amalgamation(const BlockGraph& graph,
               std::span<const int> block_at,
               const EliminationTree& tree,
               const std::vector<std::int64_t>& heights) {
    const int n = static_cast<int>(block_at.size());
    std::vector<int> of_place(n);
    for (int k = 0; k < n; ++k) {
      const int size = graph.size[block_at[k]];
      const bool goes_on = k > 0 && tree.parent[k - 1] == k &&
                           heights[k] == heights[k - 1] - graph.size[block_at[k - 1]];
      if (!goes_on) nodes_.emplace_back();
      nodes_.back().places.push_back(k);
      nodes_.back().columns += size;
      nodes_.back().height = heights[k] - size;
      of_place[k] = static_cast<int>(nodes_.size()) - 1;
    }
    for (int s = 0; s < count(); ++s) {
      const int above = tree.parent[nodes_[s].places.back()];
      if (above == kRoot) continue;
      nodes_[s].parent = of_place[above];
      nodes_[of_place[above]].children.push_back(s);
    }
  }

  // From the leaves up; of the children, those that add the fewest zeros come first.
  void join() {
    for (int s = 0; s < count(); ++s) {
      Node& node = nodes_[s];
      const std::vector<int> children = by_zeros(node);
      node.children.clear();
      for (int child : children) {
        if (pays(nodes_[child], node)) {
          absorb(child, s);
        } else {
          node.children.push_back(child);
        }
      }
    }
  }

  // Places in their new order, supernode after supernode, with the supernodes' ends.
  void write(std::vector<int>& places, std::vector<int>& begin, std::vector<int>& parent) const {
    std::vector<int> kept, number(nodes_.size(), kRoot), above;
    for (int s = 0; s < count(); ++s) {
      if (nodes_[s].joined) continue;
      number[s] = static_cast<int>(kept.size());
      kept.push_back(s);
    }
    for (int s : kept) {
      int up = nodes_[s].parent;
      while (up != kRoot && nodes_[up].joined) up = nodes_[up].parent;
      above.push_back(up == kRoot ? kRoot : number[up]);
    }
    const std::vector<int> order = postorder(above);
    const std::vector<int> rank = inverse_permutation(order);
    begin.push_back(0);
    for (int s : order) {
      const Node& node = nodes_[kept[s]];
      places.insert(places.end(), node.places.begin(), node.places.end());
      begin.push_back(static_cast<int>(places.size()));
      parent.push_back(above[s] == kRoot ? kRoot : rank[above[s]]);
    }
  }

 private:
  struct Node {
    std::vector<int> places;
    std::vector<int> children;
    std::int64_t columns = 0, height = 0;
    int parent = kRoot;
    bool joined = false;
  };

  int count() const { return static_cast<int>(nodes_.size()); }

  static std::int64_t zeros(const Node& child, const Node& node) {
    return child.columns * (node.columns + node.height - child.height);
  }
  std::vector<int> by_zeros(const Node& node) const {
    std::vector<int> children = node.children;
    std::stable_sort(children.begin(), children.end(), [&](int a, int b) {
      return zeros(nodes_[a], node) < zeros(nodes_[b], node);
    });
    return children;
  }
  static bool pays(const Node& child, const Node& node) {
    return cost_of(child.columns + node.columns, node.height) <=
           cost_of(child.columns, child.height) + cost_of(node.columns, node.height);
  }
  void absorb(int child, int into) {
    Node &from = nodes_[child], &node = nodes_[into];
    from.places.insert(from.places.end(), node.places.begin(), node.places.end());
    node.places = std::move(from.places);
    node.columns += from.columns;
    node.children.insert(node.children.end(), from.children.begin(), from.children.end());
    from.joined = true;
  }

  std::vector<Node> nodes_;
};

// The block at each place of an order in which the blocks of a supernode follow one another; sets
// where each begins, and its parent.
std::vector<int> join_blocks(const BlockGraph& graph,
                             const Adjacency& adjacency,
                             const BlockOrdering& ordering,
                             Supernodes& s) {
  const std::vector<int> given = inverse_permutation(ordering.position);
  const EliminationTree tree = make_elimination_tree(adjacency, given, ordering.position);
  Amalgamation amalgamation(
      graph, given, tree, column_heights(graph, adjacency, tree, given, ordering.position));
  amalgamation.join();
  std::vector<int> block_at;
  amalgamation.write(block_at, s.begin, s.parent);
  for (int& block : block_at) block = given[block];
  return block_at;
}

// Rows of each supernode: those of its blocks in the matrix, and those that its children leave.
void find_rows(const Adjacency& adjacency, std::span<const int> block_at, Supernodes& s) {
  const int n = s.count();
  std::vector<std::vector<int>> children(n);
  for (int k = 0; k < n; ++k) {
    if (s.parent[k] != kRoot) children[s.parent[k]].push_back(k);
  }
  std::vector<int> seen(block_at.size(), -1);
  s.rows_begin.push_back(0);
  for (int k = 0; k < n; ++k) {
    const int end = s.begin[k + 1];
    const auto meet = [&](int place) {
      if (place < end || seen[place] == k) return;
      seen[place] = k;
      s.rows.push_back(place);
    };
    for (int place = s.begin[k]; place < end; ++place) {
      for (int neighbour : adjacency.of(block_at[place])) meet(s.position[neighbour]);
    }
    for (int child : children[k]) {
      for (std::int64_t r = s.rows_begin[child]; r < s.rows_begin[child + 1]; ++r) meet(s.rows[r]);
    }
    std::sort(s.rows.begin() + s.rows_begin[k], s.rows.end());
    s.rows_begin.push_back(static_cast<std::int64_t>(s.rows.size()));
  }
}

// Rows of columns that are a multiple of 512 bytes apart are in an eighth of the sets of a
// first-level cache (of 4 KB a way), or fewer: such strides, and those of all large panels, get a
// cache line more, which makes them odd multiples of one.
std::int64_t stride_for(std::int64_t rows) {
  constexpr std::int64_t kConflicting = 512 / sizeof(double), kLargePanel = 32 * kStrip;
  return rows % kConflicting == 0 || rows > kLargePanel ? rows + kPanel : rows;
}

void lay_out_panels(Supernodes& s) {
  s.row_offset.reserve(s.rows.size());
  for (int k = 0; k < s.count(); ++k) {
    int height = 0;
    for (int place : s.rows_of(k)) {
      s.row_offset.push_back(height);
      height += s.first_column[place + 1] - s.first_column[place];
    }
    SupernodePanel panel{.columns = s.first_column[s.begin[k + 1]] - s.columns_begin(k)};
    panel.stored_columns = static_cast<int>(round_up(panel.columns, kPanel));
    panel.top = static_cast<int>(round_up(panel.columns, kStrip));
    panel.height = height;
    panel.rows = panel.top + round_up(height, kStrip);
    panel.stride = stride_for(panel.rows);
    panel.first = s.num_entries;
    s.num_entries += panel.stride * panel.stored_columns;
    s.flops += flops_of(panel.columns, height);
    s.panel.push_back(panel);
  }
}

// The largest subtree is opened until none has more than a small part of the work, so that threads
// end at about the same time: where one takes up the last part, the others wait for a 24th of the
// work at most. Parts also cost memory, for what they gather above: with a 12th or a 48th it is
// 0.95 to 1.06 times as much on the graphs of vertex_separator.cpp. Below two million flops, 50 µs
// at the reference rate (solver_costs.cpp), a part is not divided: that is some thirty times what a
// meeting of all threads costs. Neighbours with little work of the same supernode above go
// together.
class Cut {
 public:
  explicit Cut(Supernodes& s) : s_(s), flops_(s.count()), first_(s.count()) {
    std::iota(first_.begin(), first_.end(), 0);
    for (int k = 0; k < s.count(); ++k) {
      flops_[k] += flops_of(s.panel[k].columns, s.panel[k].height);
      if (s.parent[k] == kRoot) continue;
      flops_[s.parent[k]] += flops_[k];
      first_[s.parent[k]] = std::min(first_[s.parent[k]], first_[k]);
    }
  }

  void make() {
    constexpr double kShare = 1.0 / 24, kSmallest = 2e6, kTogether = 0.25;
    const double most = std::max(s_.flops * kShare, kSmallest);
    std::vector<char> below(s_.count(), 0);  // in a subtree
    double together = 0.0;
    for (int k = s_.count() - 1; k >= 0; --k) {
      const int parent = s_.parent[k];
      below[k] = flops_[k] <= most || (parent != kRoot && below[parent]);
      if (!below[k]) s_.top.push_back(k);
      if (!below[k] || (parent != kRoot && below[parent])) continue;
      const bool joins = !s_.subtrees.empty() && s_.subtrees.back().first == k + 1 &&
                         s_.parent[s_.subtrees.back().last] == parent &&
                         together + flops_[k] <= kTogether * most;
      together = joins ? together + flops_[k] : flops_[k];
      if (!joins) s_.subtrees.push_back({.first = k, .last = k});
      s_.subtrees.back().first = first_[k];
    }
    std::reverse(s_.top.begin(), s_.top.end());
    std::reverse(s_.subtrees.begin(), s_.subtrees.end());
    for (Subtrees& part : s_.subtrees) find_rows_above(part);
  }

 private:
  void find_rows_above(Subtrees& part) const {
    const int end = s_.begin[part.last + 1];
    for (int k = part.first; k <= part.last; ++k) {
      if (s_.parent[k] != kRoot && s_.parent[k] <= part.last) continue;
      part.rows.insert(part.rows.end(), s_.rows_of(k).begin(), s_.rows_of(k).end());
    }
    std::sort(part.rows.begin(), part.rows.end());
    part.rows.erase(std::unique(part.rows.begin(), part.rows.end()), part.rows.end());
    part.rows.erase(part.rows.begin(), std::lower_bound(part.rows.begin(), part.rows.end(), end));
    for (int place : part.rows) {
      part.row_offset.push_back(part.height);
      part.height += s_.first_column[place + 1] - s_.first_column[place];
    }
  }

  Supernodes& s_;
  std::vector<double> flops_;  // of each whole subtree
  std::vector<int> first_;     // its first supernode
};

}  // namespace

double Supernodes::num_bytes() const {
  double entries = static_cast<double>(num_entries);
  for (const Subtrees& part : subtrees) {
    const auto height = static_cast<double>(round_up(part.height, kStrip));
    entries += height * (height + kStrip) / 2;
  }
  return sizeof(double) * entries;
}

Supernodes make_supernodes(const BlockGraph& graph, const BlockOrdering& ordering) {
  Supernodes s;
  const Adjacency adjacency = make_adjacency(graph);
  const std::vector<int> block_at = join_blocks(graph, adjacency, ordering, s);
  s.position = inverse_permutation(block_at);
  s.first_column.push_back(0);
  for (int block : block_at) s.first_column.push_back(s.first_column.back() + graph.size[block]);
  for (int k = 0; k < s.count(); ++k) s.of_place.resize(s.begin[k + 1], k);
  find_rows(adjacency, block_at, s);
  lay_out_panels(s);
  Cut(s).make();
  return s;
}

}  // namespace sfmcpp::linear

// Clusters of cameras shared out to ranks (core/exchange.hpp): each factors its own and solves with
// them. It gets the blocks that the points of other ranks add to them, and no others are sent.
#pragma once

#include <vector>

#include "aggregates.hpp"
#include "block_sparse_schur.hpp"

namespace sfmcpp::linear {

class ClusterShares {
 public:
  // `schur` has the blocks of this rank's points.
  ClusterShares(const NormalEquations& normal,
                const BlockSparseSchur& schur,
                const Aggregates& aggregates);

  // All clusters, those of rank after rank.
  const std::vector<int>& order() const { return order_; }
  int num_own() const { return begin_[rank() + 1] - begin_[rank()]; }
  int own(int k) const { return order_[begin_[rank()] + k]; }

  // The blocks of other ranks for those of this one, as they are now.
  std::vector<double> receive() const;
  // Calls f(i, j, block) for the blocks of this rank in a cluster, as they are in BlockSparseSchur:
  // that of i = j in double precision, those of j > i transposed, in single.
  template <class F>
  void for_each_block(int cluster, const F& f) const;
  // The same for what was received, in the order of the ranks; all in double precision.
  template <class F>
  void for_each_received(int cluster, const std::vector<double>& received, const F& f) const {
    for (const Received& block : received_[cluster])
      f(block.i, block.j, received.data() + area_ * block.number);
  }

 private:
  struct Received {
    int i, j;
    long number;  // among all that were received
  };
  int rank() const { return normal_.exchange().rank(); }
  void share_out();
  void tell_what_is_sent();
  // Calls f(i, j, k) for the blocks of this rank in a cluster: where i < j the one of number k
  // behind the diagonal one of row i.
  template <class F>
  void for_each_pair(int cluster, const F& f) const;
  // Calls f(cluster, to) for the clusters of other ranks, rank after rank.
  template <class F>
  void for_each_sent(const F& f) const;

  const NormalEquations& normal_;
  const BlockSparseSchur& schur_;
  const Aggregates& aggregates_;
  long area_;  // of a block
  std::vector<int> order_;
  std::vector<int> begin_;  // of each rank's clusters in `order_`, and the end
  std::vector<std::vector<Received>>
      received_;  // for each cluster; empty but for those of this rank
};

template <class F>
void ClusterShares::for_each_pair(int cluster, const F& f) const {
  for (int m = aggregates_.begin[cluster]; m < aggregates_.begin[cluster + 1]; ++m) {
    const int i = aggregates_.members[m];
    if (normal_.graph().observations_of_camera(i) == 0) continue;
    f(i, i, 0L);
    long k = 0;
    for (int j : schur_.columns_of_row(i)) {
      if (aggregates_.of_camera[j] == cluster) f(i, j, k);
      ++k;
    }
  }
}

template <class F>
void ClusterShares::for_each_block(int cluster, const F& f) const {
  for_each_pair(cluster, [&](int i, int j, long k) {
    i == j ? f(i, i, schur_.diagonal_block(i)) : f(i, j, schur_.blocks_of_row(i) + area_ * k);
  });
}

}  // namespace sfmcpp::linear

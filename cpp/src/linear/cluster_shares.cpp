#include "cluster_shares.hpp"

#include <algorithm>
#include <numeric>

namespace sfmcpp::linear {

ClusterShares::ClusterShares(const NormalEquations& normal,
                             const BlockSparseSchur& schur,
                             const Aggregates& aggregates)
    : normal_(normal),
      schur_(schur),
      aggregates_(aggregates),
      area_(static_cast<long>(normal.map().camera_size) * normal.map().camera_size),
      received_(static_cast<std::size_t>(aggregates.count())) {
  share_out();
  tell_what_is_sent();
}

// In the order of the mean rank that has the blocks of a cluster: ranks in turn have neighbouring
// points, so that most blocks of a cluster are where it goes. Work is that of a factorised cluster.
void ClusterShares::share_out() {
  Exchange& exchange = normal_.exchange();
  const auto count = static_cast<std::size_t>(aggregates_.count());
  std::vector<double> blocks(2 * count, 0.0), mean(count);  // how many, and Σ of their ranks
  for (std::size_t k = 0; k < count; ++k) {
    for_each_pair(static_cast<int>(k), [&](int, int, long) { ++blocks[k]; });
    blocks[count + k] = exchange.rank() * blocks[k];
  }
  exchange.sum(blocks);
  for (std::size_t k = 0; k < count; ++k) mean[k] = blocks[count + k] / std::max(blocks[k], 1.0);
  order_.resize(count);
  std::iota(order_.begin(), order_.end(), 0);
  std::ranges::stable_sort(order_, {}, [&](int k) { return mean[k]; });
  const auto work = [&](int k) {
    const double cameras = aggregates_.begin[k + 1] - aggregates_.begin[k];
    return cameras * cameras;
  };
  double whole = 0.0, before = 0.0;
  for (int k : order_) whole += work(k);
  const auto ranks = static_cast<std::size_t>(exchange.num_ranks());
  begin_.push_back(0);
  for (std::size_t place = 0; place < count; before += work(order_[place++])) {
    while (begin_.size() < ranks &&
           before * static_cast<double>(ranks) >= whole * static_cast<double>(begin_.size()))
      begin_.push_back(static_cast<int>(place));
  }
  begin_.resize(ranks + 1, static_cast<int>(count));
}

template <class F>
void ClusterShares::for_each_sent(const F& f) const {
  for (int to = 0; to < normal_.exchange().num_ranks(); ++to) {
    if (to == rank()) continue;
    for (int place = begin_[to]; place < begin_[to + 1]; ++place) f(order_[place], to);
  }
}

void ClusterShares::tell_what_is_sent() {
  std::vector<double> cameras;
  std::vector<int> counts(normal_.exchange().num_ranks(), 0);
  for_each_sent([&](int cluster, int to) {
    for_each_pair(cluster, [&](int i, int j, long) {
      cameras.insert(cameras.end(), {static_cast<double>(i), static_cast<double>(j)});
      counts[to] += 2;
    });
  });
  cameras = normal_.exchange().deliver(cameras, counts);
  for (std::size_t k = 0; k < cameras.size(); k += 2) {
    const int i = static_cast<int>(cameras[k]), j = static_cast<int>(cameras[k + 1]);
    received_[aggregates_.of_camera[i]].push_back({i, j, static_cast<long>(k / 2)});
  }
}

std::vector<double> ClusterShares::receive() const {
  std::vector<double> values;
  std::vector<int> counts(normal_.exchange().num_ranks(), 0);
  for_each_sent([&](int cluster, int to) {
    for_each_block(cluster, [&](int, int, const auto* block) {
      values.insert(values.end(), block, block + area_);
      counts[to] += static_cast<int>(area_);
    });
  });
  return normal_.exchange().deliver(values, counts);
}

}  // namespace sfmcpp::linear

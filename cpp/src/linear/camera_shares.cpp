#include "camera_shares.hpp"

#include <algorithm>
#include <numeric>

namespace sfmcpp::linear {
namespace {

// Mean rank of the observations of each aggregate.
std::vector<double> mean_ranks(const NormalEquations& normal, const Aggregates& together) {
  const auto count = static_cast<std::size_t>(together.count());
  std::vector<double> sums(2 * count, 0.0);  // of observations, and of their ranks
  for (int i = 0; i < normal.graph().num_cameras; ++i) {
    const double observations = normal.graph().observations_of_camera(i);
    sums[together.of_camera[i]] += observations;
    sums[count + together.of_camera[i]] += normal.exchange().rank() * observations;
  }
  normal.exchange().sum(sums);
  std::vector<double> mean(count);
  for (std::size_t k = 0; k < count; ++k) mean[k] = sums[count + k] / std::max(sums[k], 1.0);
  return mean;
}

}  // namespace

// Ranks in turn have neighbouring points: in the order of the mean rank that observes them, most
// blocks of aggregates are where these go.
CameraShares::CameraShares(const NormalEquations& normal,
                           const Aggregates& together,
                           const std::vector<double>& work)
    : rank_(normal.exchange().rank()),
      num_ranks_(normal.exchange().num_ranks()),
      owner_(together.of_camera.size(), 0) {
  if (num_ranks_ == 1) return;
  const std::vector<double> mean = mean_ranks(normal, together);
  std::vector<int> order(mean.size());
  std::iota(order.begin(), order.end(), 0);
  std::ranges::stable_sort(order, {}, [&](int k) { return mean[k]; });
  const double whole = std::max(std::reduce(work.begin(), work.end()), 1.0);
  double before = 0.0;
  for (int k : order) {
    const int rank = std::min(static_cast<int>(before * num_ranks_ / whole), num_ranks_ - 1);
    for (int m = together.begin[k]; m < together.begin[k + 1]; ++m) {
      owner_[together.members[m]] = rank;
      before += work[together.members[m]];
    }
  }
}

std::vector<int> CameraShares::owners_of_columns(const ParameterMap& map) const {
  std::vector<int> owners(map.num_columns, 0);
  for (int i = static_cast<int>(owner_.size()) - 1; i >= 0; --i) {
    for (int k = 0; k < map.camera_size; ++k) {
      const int column = map.columns_of(i)[k];
      if (column != kNoColumn) owners[column] = owner(i);
    }
  }
  return owners;
}

}  // namespace sfmcpp::linear

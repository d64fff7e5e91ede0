#include "rank_partition.hpp"

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
CameraPartition::CameraPartition(const NormalEquations& normal,
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

std::vector<int> CameraPartition::owners_of_columns(const ParameterMap& map) const {
  std::vector<int> owners(map.num_columns, 0);
  for (int i = static_cast<int>(owner_.size()) - 1; i >= 0; --i) {
    for (int k = 0; k < map.camera_size; ++k) {
      const int column = map.columns_of(i)[k];
      if (column != kNoColumn) owners[column] = owner(i);
    }
  }
  return owners;
}

namespace {

void pick(const Vector& from, const std::vector<int>& columns, Vector& to) {
  to.resize(columns.size());
  for (std::size_t k = 0; k < columns.size(); ++k) to[k] = from[columns[k]];
}

void put(const Vector& from, const std::vector<int>& columns, Vector& to) {
  for (std::size_t k = 0; k < columns.size(); ++k) to[columns[k]] = from[k];
}

}  // namespace

ColumnPartition::ColumnPartition(const NormalEquations& normal,
                                 const CameraPartition& cameras,
                                 const std::vector<char>& touched)
    : exchange_(normal.exchange()), owner_(cameras.owners_of_columns(normal.map())) {
  if (is_only_rank()) return;
  for (std::size_t column = 0; column < owner_.size(); ++column) {
    if (is_own(column)) own_.push_back(static_cast<int>(column));
  }
  std::vector<char> is_needed(owner_.size(), 0);
  for (std::size_t i = 0; i < touched.size(); ++i) {
    for (int k = 0; touched[i] && k < normal.map().camera_size; ++k) {
      const int column = normal.map().columns_of(static_cast<int>(i))[k];
      if (column != kNoColumn) is_needed[column] = 1;
    }
  }
  find_ghosts(is_needed);
  whole_.assign(owner_.size(), 0.0);
}

void ColumnPartition::find_ghosts(const std::vector<char>& is_needed) {
  ghost_counts_.assign(exchange_.num_ranks(), 0);
  for (int rank = 0; rank < exchange_.num_ranks(); ++rank) {
    if (rank == exchange_.rank()) continue;
    for (std::size_t column = 0; column < owner_.size(); ++column) {
      if (owner_[column] != rank || !is_needed[column]) continue;
      ghosts_.push_back(static_cast<int>(column));
      ++ghost_counts_[rank];
    }
  }
  const Vector requested =
      exchange_.deliver(Vector(ghosts_.begin(), ghosts_.end()), ghost_counts_, sent_counts_);
  sent_columns_.assign(requested.begin(), requested.end());
}

void ColumnPartition::take(const Vector& whole, Vector& own) const {
  if (is_only_rank()) {
    own = whole;
  } else {
    pick(whole, own_, own);
  }
}

void ColumnPartition::place(const Vector& own, Vector& whole) const {
  if (is_only_rank()) {
    whole = own;
  } else {
    put(own, own_, whole);
  }
}

void ColumnPartition::gather(const Vector& own, Vector& whole) const {
  whole.resize(owner_.size());
  if (is_only_rank()) return place(own, whole);
  const Vector all = exchange_.gather(own);
  std::vector<std::size_t> next(exchange_.num_ranks() + 1, 0);
  for (int rank : owner_) ++next[rank + 1];
  for (int rank = 0; rank < exchange_.num_ranks(); ++rank) next[rank + 1] += next[rank];
  for (std::size_t column = 0; column < owner_.size(); ++column)
    whole[column] = all[next[owner_[column]]++];
}

const Vector& ColumnPartition::with_ghosts(const Vector& own) {
  if (is_only_rank()) return own;
  put(own, own_, whole_);
  pick(whole_, sent_columns_, sent_);
  received_.resize(ghosts_.size());
  exchange_.deliver(sent_, sent_counts_, received_, ghost_counts_);
  put(received_, ghosts_, whole_);
  return whole_;
}

void ColumnPartition::sum_ghosts(Vector& whole, Vector& own) {
  if (is_only_rank()) return own.swap(whole);
  pick(whole, ghosts_, sent_);
  received_.resize(sent_columns_.size());
  exchange_.deliver(sent_, ghost_counts_, received_, sent_counts_);
  for (std::size_t k = 0; k < sent_columns_.size(); ++k) whole[sent_columns_[k]] += received_[k];
  pick(whole, own_, own);
}

void ColumnPartition::sum_ghosts(std::vector<CompensatedSum>& whole, Vector& own) {
  if (!is_only_rank()) add_ghosts(whole);
  Vector rounded(whole.size());
  round_sums(whole, rounded);
  take(rounded, own);
}

void ColumnPartition::add_ghosts(std::vector<CompensatedSum>& whole) {
  const auto delivered = [&](double CompensatedSum::*part) {
    sent_.clear();
    for (int column : ghosts_) sent_.push_back(whole[column].*part);
    received_.resize(sent_columns_.size());
    exchange_.deliver(sent_, ghost_counts_, received_, sent_counts_);
    return received_;
  };
  const Vector sums = delivered(&CompensatedSum::sum), rests = delivered(&CompensatedSum::rest);
  for (std::size_t k = 0; k < sent_columns_.size(); ++k)
    whole[sent_columns_[k]] += CompensatedSum(sums[k], rests[k]);
}

}  // namespace sfmcpp::linear

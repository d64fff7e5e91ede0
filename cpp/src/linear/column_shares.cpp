#include "column_shares.hpp"

#include <algorithm>

namespace sfmcpp::linear {
namespace {

void pick(const Vector& from, const std::vector<int>& columns, Vector& to) {
  to.resize(columns.size());
  for (std::size_t k = 0; k < columns.size(); ++k) to[k] = from[columns[k]];
}

void put(const Vector& from, const std::vector<int>& columns, Vector& to) {
  for (std::size_t k = 0; k < columns.size(); ++k) to[columns[k]] = from[k];
}

}  // namespace

ColumnShares::ColumnShares(const NormalEquations& normal,
                           const CameraShares& cameras,
                           const std::vector<char>& touched)
    : exchange_(normal.exchange()), owner_(cameras.owners_of_columns(normal.map())) {
  if (is_alone()) return;
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
  ask_for(is_needed);
  whole_.assign(owner_.size(), 0.0);
}

void ColumnShares::ask_for(const std::vector<char>& is_needed) {
  asked_counts_.assign(exchange_.num_ranks(), 0);
  for (int rank = 0; rank < exchange_.num_ranks(); ++rank) {
    if (rank == exchange_.rank()) continue;
    for (std::size_t column = 0; column < owner_.size(); ++column) {
      if (owner_[column] != rank || !is_needed[column]) continue;
      asked_.push_back(static_cast<int>(column));
      ++asked_counts_[rank];
    }
  }
  const Vector wanted =
      exchange_.deliver(Vector(asked_.begin(), asked_.end()), asked_counts_, wanted_counts_);
  wanted_.assign(wanted.begin(), wanted.end());
}

void ColumnShares::take(const Vector& whole, Vector& own) const {
  is_alone() ? void(own = whole) : pick(whole, own_, own);
}

void ColumnShares::place(const Vector& own, Vector& whole) const {
  is_alone() ? void(whole = own) : put(own, own_, whole);
}

void ColumnShares::gather(const Vector& own, Vector& whole) const {
  whole.resize(owner_.size());
  if (is_alone()) return place(own, whole);
  const Vector all = exchange_.gather(own);
  std::vector<std::size_t> next(exchange_.num_ranks() + 1, 0);
  for (int rank : owner_) ++next[rank + 1];
  for (int rank = 0; rank < exchange_.num_ranks(); ++rank) next[rank + 1] += next[rank];
  for (std::size_t column = 0; column < owner_.size(); ++column)
    whole[column] = all[next[owner_[column]]++];
}

const Vector& ColumnShares::spread(const Vector& own) {
  if (is_alone()) return own;
  put(own, own_, whole_);
  pick(whole_, wanted_, sent_);
  received_.resize(asked_.size());
  exchange_.deliver(sent_, wanted_counts_, received_, asked_counts_);
  put(received_, asked_, whole_);
  return whole_;
}

void ColumnShares::collect(Vector& whole, Vector& own) {
  if (is_alone()) return own.swap(whole);
  pick(whole, asked_, sent_);
  received_.resize(wanted_.size());
  exchange_.deliver(sent_, asked_counts_, received_, wanted_counts_);
  for (std::size_t k = 0; k < wanted_.size(); ++k) whole[wanted_[k]] += received_[k];
  pick(whole, own_, own);
}

}  // namespace sfmcpp::linear

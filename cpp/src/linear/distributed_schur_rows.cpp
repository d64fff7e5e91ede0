#include "distributed_schur_rows.hpp"

#include <algorithm>
#include <numeric>
#include <utility>

namespace sfmcpp::linear {
namespace {

using Structure = std::shared_ptr<const ReducedStructure>;

Structure of_points_here(const NormalEquations& normal,
                         const CameraPartition& partition,
                         const Structure& structure) {
  if (partition.are_all_own()) return structure;
  return std::make_shared<ReducedStructure>(
      ReducedStructure{.pattern = make_camera_pattern(normal.graph(), {}, normal.pool())});
}

Structure of_own_rows(const CameraPartition& partition, const Structure& structure) {
  if (partition.are_all_own()) return structure;
  const CameraPattern& whole = structure->pattern;
  CameraPattern own{.row_begin = {0}, .column = {}};
  for (int i = 0; i < whole.num_rows(); ++i) {
    const auto row = whole.column.begin() + whole.row_begin[i];
    const auto end = partition.is_own(i) ? whole.column.begin() + whole.row_begin[i + 1] : row + 1;
    own.column.insert(own.column.end(), row, end);
    own.row_begin.push_back(static_cast<long>(own.column.size()));
  }
  return std::make_shared<ReducedStructure>(ReducedStructure{.pattern = std::move(own)});
}

std::span<const int> behind_diagonal(const CameraPattern& pattern, int i) {
  return {pattern.column.data() + pattern.row_begin[i] + 1,
          pattern.column.data() + pattern.row_begin[i + 1]};
}

void add(const double* from, long count, double* to) {
  for (long k = 0; k < count; ++k) to[k] += from[k];
}

// The sums, and behind them what is rounded off.
void add_compensated_sums(const double* from, long count, double* to) {
  for (long k = 0; k < count; ++k) {
    add_compensated(to[k], to[count + k], from[k]);
    to[count + k] += from[count + k];
  }
}

}  // namespace

DistributedSchurRows::DistributedSchurRows(const NormalEquations& normal,
                                           const PointElimination& elimination,
                                           const CameraPartition& partition,
                                           const Structure& structure)
    : normal_(normal),
      partition_(partition),
      here_(of_points_here(normal, partition, structure)),
      own_(of_own_rows(partition, structure)),
      rows_(normal, elimination, here_->pattern),
      received_rows_(normal.graph().num_cameras) {
  if (partition.are_all_own()) return;
  places_.resize(normal.pool().num_threads(), std::vector<int>(normal.graph().num_cameras));
  parts_.resize(normal.pool().num_threads());
  send_headers();
}

// Of each row: its camera, how many blocks, and their columns.
void DistributedSchurRows::send_headers() {
  const int ranks = normal_.exchange().num_ranks();
  std::vector<double> headers;
  std::vector<int> header_counts(ranks, 0), counts;
  sent_counts_.assign(ranks, 0);
  long first = 0;
  for (int to = 0; to < ranks; ++to) {
    if (to == normal_.exchange().rank()) continue;
    for (int i = 0; i < normal_.graph().num_cameras; ++i) {
      if (partition_.owner(i) != to || normal_.graph().observations_of_camera(i) == 0) continue;
      const std::span<const int> columns = behind_diagonal(here_->pattern, i);
      const auto blocks = static_cast<double>(columns.size());
      headers.insert(headers.end(), {static_cast<double>(i), blocks});
      headers.insert(headers.end(), columns.begin(), columns.end());
      header_counts[to] += 2 + static_cast<int>(columns.size());
      sent_rows_.push_back({i, first});
      first += numbers_of(columns.size());
      sent_counts_[to] += static_cast<int>(numbers_of(columns.size()));
    }
  }
  read_headers(normal_.exchange().deliver(headers, header_counts, counts), counts);
}

void DistributedSchurRows::read_headers(const std::vector<double>& headers,
                                        const std::vector<int>& counts) {
  long first = 0;
  auto next = headers.begin();
  for (int count : counts) {
    const long before = first;
    for (const auto end = next + count; next != end;) {
      const int i = static_cast<int>(*next++), blocks = static_cast<int>(*next++);
      received_rows_[i].push_back({.columns = {next, next + blocks}, .first = first});
      next += blocks;
      first += numbers_of(static_cast<std::size_t>(blocks));
    }
    received_counts_.push_back(static_cast<int>(first - before));
  }
  received_.resize(static_cast<std::size_t>(first));
}

void DistributedSchurRows::exchange() {
  if (partition_.are_all_own()) return;
  AlignedVector<double> sent(std::reduce(sent_counts_.begin(), sent_counts_.end(), std::size_t{0}));
  normal_.pool().parallel_for_worker(static_cast<int>(sent_rows_.size()), [&](int k, int worker) {
    double* diagonal = sent.data() + sent_rows_[k].first;
    double* rhs = diagonal + size() * size();
    rows_.form(sent_rows_[k].camera, worker, diagonal, rhs + 2 * size(), rhs);
  });
  normal_.exchange().deliver(sent, sent_counts_, received_, received_counts_);
}

void DistributedSchurRows::form(int i, int worker, double* diagonal, double* blocks, double* rhs) {
  if (partition_.are_all_own()) return rows_.form(i, worker, diagonal, blocks, rhs);
  const std::span<const int> columns = behind_diagonal(pattern(), i);
  std::fill_n(blocks, size() * size() * static_cast<long>(columns.size()), 0.0);
  if (!partition_.is_own(i)) {
    std::fill_n(diagonal, size() * size(), 0.0);
    std::fill_n(rhs, 2 * size(), 0.0);
    return;
  }
  std::vector<int>& place = places_[worker];
  for (std::size_t k = 0; k < columns.size(); ++k) place[columns[k]] = static_cast<int>(k);
  const auto add_blocks = [&](std::span<const int> of, const double* from) {
    for (std::size_t k = 0; k < of.size(); ++k)
      add(from + size() * size() * static_cast<long>(k),
          size() * size(),
          blocks + size() * size() * place[of[k]]);
  };
  const std::span<const int> here = behind_diagonal(here_->pattern, i);
  AlignedVector<double>& part = parts_[worker];
  part.resize(static_cast<std::size_t>(size() * size()) * here.size());
  rows_.form(i, worker, diagonal, part.data(), rhs);
  add_blocks(here, part.data());
  for (const Received& row : received_rows_[i]) {
    const double* from = received_.data() + row.first;
    add(from, size() * size(), diagonal);
    add_compensated_sums(from + size() * size(), size(), rhs);
    add_blocks(row.columns, from + size() * (size() + 2));
  }
}

}  // namespace sfmcpp::linear

#include "distributed_schur_rows.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace sfmcpp::linear {
namespace {

// Numbers that are on their way at a time; more rounds than these would wait for one another.
constexpr double kNumbersOfRound = 1 << 16;
constexpr double kMostRounds = 8;

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
  rows_.sum_on(grid_);
  if (partition.are_all_own()) return;
  places_.resize(normal.pool().num_threads(), std::vector<int>(normal.graph().num_cameras));
  parts_.resize(normal.pool().num_threads());
  const std::vector<int> none(normal.exchange().num_ranks(), 0);
  rounds_.assign(choose_rounds(), {.sent = {}, .sent_counts = none, .received_counts = none});
  send_headers();
}

std::vector<int> DistributedSchurRows::rows_to(int rank) const {
  std::vector<int> rows;
  for (int i = 0; rank != normal_.exchange().rank() && i < normal_.graph().num_cameras; ++i) {
    if (partition_.owner(i) == rank && normal_.graph().observations_of_camera(i) > 0)
      rows.push_back(i);
  }
  return rows;
}

int DistributedSchurRows::choose_rounds() const {
  double sent = 0.0;
  for (int to = 0; to < normal_.exchange().num_ranks(); ++to) {
    for (int i : rows_to(to))
      sent += static_cast<double>(numbers_of(behind_diagonal(here_->pattern, i).size()));
  }
  const double rounds = std::ceil(normal_.exchange().max(sent) / kNumbersOfRound);
  return static_cast<int>(std::clamp(rounds, 1.0, kMostRounds));
}

// Of each row: its camera, its round, how many blocks, and their columns.
void DistributedSchurRows::send_headers() {
  const int ranks = normal_.exchange().num_ranks();
  std::vector<double> headers;
  std::vector<int> header_counts(ranks, 0), counts;
  for (int to = 0; to < ranks; ++to) {
    const std::vector<int> rows = rows_to(to);
    for (std::size_t k = 0; k < rows.size(); ++k) {
      const std::span<const int> columns = behind_diagonal(here_->pattern, rows[k]);
      const std::size_t number = k * rounds_.size() / rows.size();
      for (const auto value : {static_cast<std::size_t>(rows[k]), number, columns.size()})
        headers.push_back(static_cast<double>(value));
      headers.insert(headers.end(), columns.begin(), columns.end());
      header_counts[to] += 3 + static_cast<int>(columns.size());
      Round& round = rounds_[number];
      round.sent.push_back({rows[k], round.num_sent});
      round.num_sent += numbers_of(columns.size());
      round.sent_counts[to] += static_cast<int>(numbers_of(columns.size()));
    }
  }
  read_headers(normal_.exchange().deliver(headers, header_counts, counts), counts);
}

void DistributedSchurRows::read_headers(const std::vector<double>& headers,
                                        const std::vector<int>& counts) {
  auto next = headers.begin();
  for (std::size_t from = 0; from < counts.size(); ++from) {
    for (const auto end = next + counts[from]; next != end;) {
      const int i = static_cast<int>(*next++), number = static_cast<int>(*next++);
      const int blocks = static_cast<int>(*next++);
      Round& round = rounds_[number];
      received_rows_[i].push_back(
          {.columns = {next, next + blocks}, .round = number, .first = round.num_received});
      next += blocks;
      const long numbers = numbers_of(static_cast<std::size_t>(blocks));
      round.num_received += numbers;
      round.received_counts[from] += static_cast<int>(numbers);
    }
  }
  std::vector<long> before = {0};  // each round
  for (const Round& round : rounds_) before.push_back(before.back() + round.num_received);
  for (std::vector<Received>& rows : received_rows_) {
    for (Received& row : rows) row.first += before[row.round];
  }
  received_.resize(static_cast<std::size_t>(before.back()));
}

void DistributedSchurRows::exchange() {
  grid_.set(normal_);
  std::span<double> received(received_);
  AlignedVector<double> sent;
  for (const Round& round : rounds_) {
    sent.resize(static_cast<std::size_t>(round.num_sent));
    normal_.pool().parallel_for_worker(static_cast<int>(round.sent.size()), [&](int k, int worker) {
      double* diagonal = sent.data() + round.sent[k].first;
      double* rhs = diagonal + size() * size();
      rows_.form(round.sent[k].camera, worker, diagonal, rhs + 2 * size(), rhs);
    });
    const auto count = static_cast<std::size_t>(round.num_received);
    normal_.exchange().deliver(
        sent, round.sent_counts, received.first(count), round.received_counts);
    received = received.subspan(count);
  }
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

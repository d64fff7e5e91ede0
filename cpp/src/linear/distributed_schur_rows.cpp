#include "distributed_schur_rows.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <span>
#include <utility>

namespace sfmcpp::linear {
namespace {

// Numbers that are on their way at a time; more rounds than these would wait for one another.
constexpr double kNumbersOfRound = 1 << 16;
constexpr double kMostRounds = 16;

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
    const std::span<const int> row = whole.columns_of_row(i);
    own.column.insert(
        own.column.end(), row.begin(), partition.is_own(i) ? row.end() : row.begin() + 1);
    own.row_begin.push_back(static_cast<long>(own.column.size()));
  }
  return std::make_shared<ReducedStructure>(ReducedStructure{.pattern = std::move(own)});
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
  divide_into_rounds();
  if (partition.are_all_own()) return;
  numbers_.resize(normal.pool().num_threads(), std::vector<int>(normal.graph().num_cameras));
  parts_.resize(normal.pool().num_threads());
  send_headers();
  for (const Round& round : rounds_) {
    sent_.reserve(static_cast<std::size_t>(round.num_sent));
    received_.reserve(static_cast<std::size_t>(round.num_received));
  }
}

bool DistributedSchurRows::is_sent(int camera) const {
  return !partition_.is_own(camera) && normal_.graph().observations_of_camera(camera) > 0;
}

// Of each row, those that other ranks than its own send of it.
std::vector<double> DistributedSchurRows::numbers_on_their_way() const {
  std::vector<double> numbers(normal_.graph().num_cameras, 0.0);
  for (int i = 0; i < normal_.graph().num_cameras; ++i) {
    if (is_sent(i))
      numbers[i] = static_cast<double>(numbers_of(here_->pattern.columns_behind(i).size()));
  }
  return numbers;
}

int DistributedSchurRows::choose_rounds(const std::vector<double>& numbers) const {
  const double sent = std::reduce(numbers.begin(), numbers.end());
  const double rounds = std::ceil(normal_.exchange().max(sent) / kNumbersOfRound);
  return static_cast<int>(std::clamp(rounds, 1.0, kMostRounds));
}

// Every rank sends and receives in each: the rows of each are divided in their order, one half of a
// round by what is on its way, which sets the memory, the other by rows, which set the time.
void DistributedSchurRows::divide_into_rounds() {
  const int ranks = normal_.exchange().num_ranks(), cameras = normal_.graph().num_cameras;
  const std::vector<int> none(ranks, 0);
  std::vector<double> numbers = numbers_on_their_way();
  const int rounds = choose_rounds(numbers);
  rounds_.assign(rounds, {.rows = {}, .sent = {}, .sent_counts = none, .received_counts = none});
  normal_.exchange().sum(numbers);
  std::vector<double> rows(ranks), sums(ranks), before(ranks);
  for (int i = 0; i < cameras; ++i) {
    rows[partition_.owner(i)] += 1.0;
    sums[partition_.owner(i)] += numbers[i];
  }
  for (int i = 0; i < cameras; ++i) {
    const int owner = partition_.owner(i);
    const int round = std::min(static_cast<int>(before[owner] * rounds), rounds - 1);
    before[owner] += 0.5 / rows[owner] + 0.5 * numbers[i] / std::max(sums[owner], 1.0);
    round_of_row_.push_back(round);
    rounds_[round].rows.push_back(i);
  }
}

// Of each row: its camera, how many blocks, and their columns.
void DistributedSchurRows::send_headers() {
  const int ranks = normal_.exchange().num_ranks();
  std::vector<double> headers;
  std::vector<int> header_counts(ranks, 0), counts;
  for (int to = 0; to < ranks; ++to) {
    for (int i = 0; i < normal_.graph().num_cameras; ++i) {
      if (!is_sent(i) || partition_.owner(i) != to) continue;
      const std::span<const int> columns = here_->pattern.columns_behind(i);
      headers.push_back(i);
      headers.push_back(static_cast<double>(columns.size()));
      headers.insert(headers.end(), columns.begin(), columns.end());
      header_counts[to] += 2 + static_cast<int>(columns.size());
      Round& round = rounds_[round_of_row_[i]];
      round.sent.push_back({i, round.num_sent});
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
      const int i = static_cast<int>(*next++), blocks = static_cast<int>(*next++);
      Round& round = rounds_[round_of_row_[i]];
      received_rows_[i].push_back({.columns = {next, next + blocks}, .first = round.num_received});
      next += blocks;
      const long numbers = numbers_of(static_cast<std::size_t>(blocks));
      round.num_received += numbers;
      round.received_counts[from] += static_cast<int>(numbers);
    }
  }
}

void DistributedSchurRows::exchange(int round) {
  if (partition_.are_all_own()) return;
  const Round& now = rounds_[round];
  sent_.resize(static_cast<std::size_t>(now.num_sent));
  received_.resize(static_cast<std::size_t>(now.num_received));
  normal_.pool().parallel_for_worker(static_cast<int>(now.sent.size()), [&](int k, int worker) {
    double* diagonal = sent_.data() + now.sent[k].first;
    double* rhs = diagonal + size() * size();
    form_here(now.sent[k].camera, {diagonal, rhs + 2 * size(), rhs}, worker);
  });
  normal_.exchange().deliver(sent_, now.sent_counts, received_, now.received_counts);
}

void DistributedSchurRows::form(std::span<const int> cameras,
                                std::span<const SchurRows::Place> places,
                                int worker) {
  if (partition_.are_all_own()) return rows_.form(cameras, places, worker);
  for (std::size_t k = 0; k < cameras.size(); ++k)
    form_with_received(cameras[k], places[k], worker);
}

void DistributedSchurRows::form_with_received(int i, const SchurRows::Place& place, int worker) {
  const std::span<const int> columns = pattern().columns_behind(i);
  std::fill_n(place.blocks, size() * size() * static_cast<long>(columns.size()), 0.0);
  if (!partition_.is_own(i)) {
    std::fill_n(place.diagonal, size() * size(), 0.0);
    std::fill_n(place.rhs, 2 * size(), 0.0);
    return;
  }
  std::vector<int>& number = numbers_[worker];
  for (std::size_t k = 0; k < columns.size(); ++k) number[columns[k]] = static_cast<int>(k);
  const auto add_blocks = [&](std::span<const int> of, const double* from) {
    for (std::size_t k = 0; k < of.size(); ++k)
      add(from + size() * size() * static_cast<long>(k),
          size() * size(),
          place.blocks + size() * size() * number[of[k]]);
  };
  const std::span<const int> here = here_->pattern.columns_behind(i);
  AlignedVector<double>& part = parts_[worker];
  part.resize(static_cast<std::size_t>(size() * size()) * here.size());
  form_here(i, {place.diagonal, part.data(), place.rhs}, worker);
  add_blocks(here, part.data());
  for (const Received& row : received_rows_[i]) {
    const double* from = received_.data() + row.first;
    add(from, size() * size(), place.diagonal);
    add_compensated_sums(from + size() * size(), size(), place.rhs);
    add_blocks(row.columns, from + size() * (size() + 2));
  }
}

}  // namespace sfmcpp::linear

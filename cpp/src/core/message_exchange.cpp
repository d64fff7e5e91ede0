#include "sfmcpp/core/message_exchange.hpp"

#include <algorithm>
#include <numeric>

#include "sfmcpp/core/stopwatch.hpp"

namespace sfmcpp {
namespace {

// Up to this many numbers, latency costs more than to send all to everyone.
constexpr std::size_t kFew = 256;
// Numbers that pass at a time: they set how much room an exchange takes.
constexpr std::size_t kPiece = std::size_t{1} << 16;

// f(piece) for all pieces of the values, in their order.
template <class F>
void for_each_piece(std::span<double> values, std::size_t size, const F& f) {
  for (std::size_t begin = 0; begin < values.size(); begin += size)
    f(values.subspan(begin, std::min(size, values.size() - begin)));
}

void add(double* to, const double* from, std::size_t size) {
  for (std::size_t k = 0; k < size; ++k) to[k] += from[k];
}

void add_compensated_sums(double* to, const double* from, std::size_t size) {
  for (std::size_t k = 0; k < size; k += 2) {
    add_compensated(to[k], to[k + 1], from[k]);
    to[k + 1] += from[k + 1];
  }
}

// Σ of arrays that follow one another, in the first one's place.
void add_to_first(std::span<double> arrays, std::size_t size, std::size_t width) {
  const auto add_terms = width == 1 ? add : add_compensated_sums;
  for (std::size_t begin = size; begin < arrays.size(); begin += size)
    add_terms(arrays.data(), arrays.data() + begin, size);
}

}  // namespace

void MessageExchange::sum(std::span<CompensatedSum> values) {
  static_assert(sizeof(CompensatedSum) == 2 * sizeof(double) && kPiece % 2 == 0);
  if (!values.empty()) sum_of({&values.front().sum, 2 * values.size()}, 2);
}

void MessageExchange::sum_of(std::span<double> values, std::size_t width) {
  for_each_piece(values, kPiece, [&](std::span<double> piece) {
    piece.size() <= kFew ? sum_few(piece, width) : sum_many(piece, width);
  });
  if (values.size() > kFew) free_buffers();
}

void MessageExchange::max(std::span<double> values) {
  for_each_piece(values, kFew, [this](std::span<double> piece) {
    all_gather(piece);
    for (std::size_t k = 0; k < all_.size(); ++k)
      piece[k % piece.size()] = std::max(piece[k % piece.size()], all_[k]);
  });
}

std::vector<double> MessageExchange::gather(std::span<const double> values) {
  const double size = static_cast<double>(values.size());
  all_gather({&size, 1});
  const std::vector<std::size_t> sizes(all_.begin(), all_.end());
  std::vector<std::size_t> places(sizes.size());
  std::exclusive_scan(sizes.begin(), sizes.end(), places.begin(), std::size_t{0});
  std::vector<double> gathered(places.back() + sizes.back());
  const std::size_t longest = *std::ranges::max_element(sizes);
  for (std::size_t begin = 0; begin < longest; begin += kPiece) {
    const std::size_t room = std::min(kPiece, longest - begin);
    // Of a rank that has no more, nothing is read.
    const auto count_of = [&](std::size_t of) {
      return of > begin ? std::min(of - begin, room) : 0;
    };
    std::vector<double> piece(room);
    std::copy_n(
        values.data() + std::min(begin, values.size()), count_of(values.size()), piece.data());
    all_gather(piece);
    for (std::size_t r = 0; r < sizes.size(); ++r)
      std::copy_n(all_.data() + r * room, count_of(sizes[r]), gathered.data() + places[r] + begin);
  }
  if (longest > kFew) free_buffers();
  return gathered;
}

void MessageExchange::deliver(std::span<const double> values,
                              std::span<const int> counts,
                              std::span<double> received,
                              std::span<const int> received_counts) {
  const Stopwatch watch;
  transport_.all_to_all(values, counts, received, received_counts);
  const auto kept = static_cast<std::size_t>(counts[rank()]);
  note(static_cast<double>((values.size() - kept) * sizeof(double)), watch.seconds());
}

bool MessageExchange::agree(bool mine) { return Exchange::max(mine ? 1.0 : 0.0) > 0.0; }

void MessageExchange::sum_few(std::span<double> values, std::size_t width) {
  all_gather(values);
  add_to_first(all_, values.size(), width);
  std::copy_n(all_.begin(), values.size(), values.begin());
}

void MessageExchange::sum_many(std::span<double> values, std::size_t width) {
  const auto ranks = static_cast<std::size_t>(num_ranks());
  const std::size_t terms = values.size() / width;
  const std::size_t share = (terms + ranks - 1) / ranks * width;
  mine_.assign(values.begin(), values.end());
  mine_.resize(share * ranks);
  all_to_all();
  add_to_first(received_, share, width);
  all_gather(std::span(received_).first(share));
  std::copy_n(all_.begin(), values.size(), values.begin());
}

void MessageExchange::all_gather(std::span<const double> mine) {
  const Stopwatch watch;
  all_.resize(mine.size() * static_cast<std::size_t>(num_ranks()));
  transport_.all_gather(mine, all_);
  note(static_cast<double>((all_.size() - mine.size()) * sizeof(double)), watch.seconds());
}

void MessageExchange::all_to_all() {
  const Stopwatch watch;
  received_.resize(mine_.size());
  transport_.all_to_all(mine_, received_);
  const std::size_t kept = mine_.size() / static_cast<std::size_t>(num_ranks());
  note(static_cast<double>((mine_.size() - kept) * sizeof(double)), watch.seconds());
}

// Long arrays are exchanged a few times a step, and what they pass through is idle in between.
void MessageExchange::free_buffers() {
  for (std::vector<double>* buffer : {&mine_, &received_, &all_})
    std::vector<double>().swap(*buffer);
}

void MessageExchange::note(double bytes, double seconds) {
  ++traffic_.messages;
  traffic_.bytes_sent += bytes;
  traffic_.seconds_waited += seconds;
}

}  // namespace sfmcpp

// Sums, maxima and lists over a transport: threads play the processes.
#include "sfmcpp/core/message_exchange.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>
#include <thread>

#include <gtest/gtest.h>

#include "support/barrier.hpp"

namespace sfmcpp::message_exchange_test {
namespace {

// Where the ranks lay out what they bring.
struct Table {
  explicit Table(int num_ranks) : gate(num_ranks), brought(num_ranks), counts(num_ranks) {}
  support::Barrier gate;
  std::vector<std::span<const double>> brought;
  std::vector<std::span<const int>> counts;
};

class ThreadedTransport final : public Transport {
 public:
  ThreadedTransport(Table& table, int rank) : table_(table), rank_(rank) {}

  int rank() const override { return rank_; }
  int num_ranks() const override { return static_cast<int>(table_.brought.size()); }
  void all_gather(std::span<const double> mine, std::span<double> all) override {
    pass(mine, all, mine.size(), 0);
  }
  void all_to_all(std::span<const double> mine, std::span<double> received) override {
    const std::size_t share = mine.size() / table_.brought.size();
    pass(mine, received, share, share * static_cast<std::size_t>(rank_));
  }

  void all_to_all(std::span<const double> mine,
                  std::span<const int> counts,
                  std::span<double> received,
                  std::span<const int> received_counts) override {
    table_.brought[rank_] = mine;
    table_.counts[rank_] = counts;
    table_.gate.arrive_and_wait();
    auto place = received.begin();
    for (std::size_t r = 0; r < table_.counts.size(); ++r) {
      const std::span<const int> theirs = table_.counts[r];
      ASSERT_EQ(theirs[rank_], received_counts[r]);
      const int before = std::reduce(theirs.begin(), theirs.begin() + rank_);
      place = std::copy_n(table_.brought[r].begin() + before, theirs[rank_], place);
    }
    ASSERT_EQ(place, received.end());
    table_.gate.arrive_and_wait();
  }

 private:
  // Of what each rank brings, `size` numbers from `begin` on.
  void pass(std::span<const double> mine,
            std::span<double> received,
            std::size_t size,
            std::size_t begin) {
    table_.brought[rank_] = mine;
    table_.gate.arrive_and_wait();
    ASSERT_EQ(received.size(), size * table_.brought.size());
    for (std::size_t r = 0; r < table_.brought.size(); ++r)
      std::copy_n(table_.brought[r].begin() + begin, size, received.begin() + size * r);
    table_.gate.arrive_and_wait();
  }

  Table& table_;
  int rank_;
};

void on_ranks(int num_ranks, const std::function<void(MessageExchange&)>& f) {
  Table table(num_ranks);
  std::vector<std::thread> threads;
  for (int rank = 0; rank < num_ranks; ++rank) {
    threads.emplace_back([&, rank] {
      ThreadedTransport transport(table, rank);
      MessageExchange exchange(transport);
      f(exchange);
    });
  }
  for (std::thread& thread : threads) thread.join();
}

// Of many orders of magnitude: another order of the sum has other bits.
double value_of(int rank, std::size_t k) {
  return std::ldexp(1.0 + 0.1 * rank + 0.01 * static_cast<double>(k % 17), 11 * ((rank + k) % 5));
}

std::vector<double> values_of(int rank, std::size_t size) {
  std::vector<double> values(size);
  for (std::size_t k = 0; k < size; ++k) values[k] = value_of(rank, k);
  return values;
}

class MessagesOf : public testing::TestWithParam<std::tuple<int, std::size_t>> {};

TEST_P(MessagesOf, SumAndMaxGoInTheOrderOfTheRanks) {
  const auto [ranks, size] = GetParam();
  std::vector<double> sum = values_of(0, size), largest = sum;
  for (int rank = 1; rank < ranks; ++rank) {
    for (std::size_t k = 0; k < size; ++k) {
      sum[k] += value_of(rank, k);
      largest[k] = std::max(largest[k], value_of(rank, k));
    }
  }
  on_ranks(ranks, [&, size = size](MessageExchange& exchange) {
    std::vector<double> summed = values_of(exchange.rank(), size), found = summed;
    exchange.sum(summed);
    exchange.max(found);
    EXPECT_EQ(summed, sum);
    EXPECT_EQ(found, largest);
  });
}

// Terms that cancel to rounding: any other sum depends on which rank has which.
TEST_P(MessagesOf, CompensatedSumsHaveTheBitsOfAnyOrder) {
  const auto [ranks, size] = GetParam();
  const auto terms_of = [size = size](int place) {
    std::vector<CompensatedSum> terms(size);
    for (std::size_t k = 0; k < size; ++k) {
      terms[k] += (place % 2 == 0 ? 1.0 : -1.0) * value_of(place / 2, k);
      terms[k] += 1e-9 * value_of(place, k + 1);
    }
    return terms;
  };
  const auto summed = [&](int shift) {
    std::vector<double> result;
    on_ranks(ranks, [&](MessageExchange& exchange) {
      std::vector<CompensatedSum> sums = terms_of((exchange.rank() + shift) % exchange.num_ranks());
      exchange.sum(sums);
      if (!exchange.is_root()) return;
      result.resize(sums.size());
      std::ranges::transform(sums, result.begin(), &CompensatedSum::value);
    });
    return result;
  };
  EXPECT_EQ(summed(1), summed(0));
}

TEST_P(MessagesOf, ListsOfAnyLengthFollowOneAnother) {
  const auto [ranks, size] = GetParam();
  std::vector<double> all;
  for (int rank = 0; rank < ranks; ++rank) {
    const std::vector<double> list = values_of(rank, rank == 1 ? 0 : size + rank);
    all.insert(all.end(), list.begin(), list.end());
  }
  on_ranks(ranks, [&, size = size](MessageExchange& exchange) {
    const int rank = exchange.rank();
    EXPECT_EQ(exchange.gather(values_of(rank, rank == 1 ? 0 : size + rank)), all);
  });
}

// Around what passes at a time and what goes to all at once.
INSTANTIATE_TEST_SUITE_P(
    All,
    MessagesOf,
    testing::Combine(testing::Values(1, 2, 3),
                     testing::Values(0, 1, 256, 257, 1000, 65536, 65539, 200000)));

// To rank r rank s has s + 2 r numbers; rank 0 has none for itself.
TEST(MessageExchange, DeliversToEachWhatIsForIt) {
  const auto count = [](int from, int to) { return from + 2 * to; };
  const auto value = [](int from, int to, int k) { return 100.0 * from + 10.0 * to + k; };
  on_ranks(3, [&](MessageExchange& exchange) {
    const int rank = exchange.rank();
    std::vector<double> values, expected;
    std::vector<int> counts;
    for (int other = 0; other < 3; ++other) {
      counts.push_back(count(rank, other));
      for (int k = 0; k < count(rank, other); ++k) values.push_back(value(rank, other, k));
      for (int k = 0; k < count(other, rank); ++k) expected.push_back(value(other, rank, k));
    }
    std::vector<int> received;
    EXPECT_EQ(exchange.deliver(values, counts, received), expected);
    EXPECT_EQ(received, (std::vector{count(0, rank), count(1, rank), count(2, rank)}));
    const double sent = static_cast<double>(values.size()) - counts[rank];
    EXPECT_EQ(exchange.traffic().bytes_sent, sizeof(double) * (2 + sent));
    EXPECT_EQ(exchange.deliver({}, std::vector<int>(3), received), std::vector<double>());
  });
}

TEST(MessageExchange, OneSaysItForAll) {
  for (int saying : {0, 1, 2}) {
    on_ranks(3, [&](MessageExchange& exchange) {
      EXPECT_TRUE(exchange.agree(exchange.rank() == saying));
      EXPECT_FALSE(exchange.agree(false));
    });
  }
}

// A long sum sends each number twice, but for what a rank adds up itself.
TEST(MessageExchange, CountsWhatItSends) {
  on_ranks(4, [&](MessageExchange& exchange) {
    std::vector<double> values(4000);
    exchange.sum(values);
    EXPECT_EQ(exchange.traffic().bytes_sent, sizeof(double) * 2 * 3000);
    EXPECT_EQ(exchange.traffic().messages, 2);
  });
}

}  // namespace
}  // namespace sfmcpp::message_exchange_test

// The exchange between processes, over any means of moving numbers between them (MPI).
//
// Sums are taken here, in the order of the ranks: those of MPI_Allreduce may have other bits from
// run to run. Of a long array each rank adds up one share, so that none holds all arrays of all.
#pragma once

#include "sfmcpp/core/exchange.hpp"

namespace sfmcpp {

// Moves numbers between ranks and changes none. All ranks bring the same number of them.
class Transport {
 public:
  virtual ~Transport() = default;

  virtual int rank() const = 0;
  virtual int num_ranks() const = 0;
  // `all` gets those of every rank, rank after rank.
  virtual void all_gather(std::span<const double> mine, std::span<double> all) = 0;
  // `mine` has as many for each rank, rank after rank; `received` gets what each has for this one.
  virtual void all_to_all(std::span<const double> mine, std::span<double> received) = 0;
  // The same where a rank has `counts` numbers for each and gets `received_counts` of each.
  virtual void all_to_all(std::span<const double> mine,
                          std::span<const int> counts,
                          std::span<double> received,
                          std::span<const int> received_counts) = 0;
};

class MessageExchange final : public Exchange {
 public:
  // What has passed so far.
  struct Traffic {
    long messages = 0;            // collective calls
    double bytes_sent = 0.0;      // to other ranks, by this one
    double seconds_waited = 0.0;  // for the others and for the network
  };

  explicit MessageExchange(Transport& transport) : transport_(transport) {}

  using Exchange::deliver;
  using Exchange::max;
  using Exchange::sum;
  int rank() const override { return transport_.rank(); }
  int num_ranks() const override { return transport_.num_ranks(); }
  void sum(std::span<double> values) override { sum_of(values, 1); }
  void sum(std::span<CompensatedSum> values) override;
  void max(std::span<double> values) override;
  std::vector<double> gather(std::span<const double> values) override;
  void deliver(std::span<const double> values,
               std::span<const int> counts,
               std::span<double> received,
               std::span<const int> received_counts) override;
  bool agree(bool mine) override;

  const Traffic& traffic() const { return traffic_; }

 private:
  // Of terms of so many numbers: of two, they are compensated sums.
  void sum_of(std::span<double> values, std::size_t width);
  void sum_few(std::span<double> values, std::size_t width);
  void sum_many(std::span<double> values, std::size_t width);
  // `all_` has those of every rank then.
  void all_gather(std::span<const double> mine);
  // `received_` has what each rank has for this one in `mine_` then.
  void all_to_all();
  void free_buffers();
  void note(double bytes, double seconds);

  Transport& transport_;
  Traffic traffic_;
  std::vector<double> mine_, received_, all_;
};

}  // namespace sfmcpp

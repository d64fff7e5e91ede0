// The exchange over a communicator of Python's: mpi4py's, or anything with its calls for buffers.
#pragma once

#include <pybind11/pybind11.h>

#include "sfmcpp/core/message_exchange.hpp"

namespace sfmcpp::bindings {

namespace py = pybind11;

// Called without the GIL. No Python code runs between the ranks' messages where the communicator is
// mpi4py's: a signal waits until the core asks for it, and cannot part the ranks.
class CommunicatorTransport final : public Transport {
 public:
  explicit CommunicatorTransport(const py::object& communicator);

  int rank() const override { return rank_; }
  int num_ranks() const override { return num_ranks_; }
  void all_gather(std::span<const double> mine, std::span<double> all) override;
  void all_to_all(std::span<const double> mine, std::span<double> received) override;
  void all_to_all(std::span<const double> mine,
                  std::span<const int> counts,
                  std::span<double> received,
                  std::span<const int> received_counts) override;

 private:
  int rank_, num_ranks_;
  py::object all_gather_, all_to_all_, all_to_all_of_counts_;
};

// A communicator and what has passed through it; lives as long as Python wants to read that.
class CommunicatorExchange {
 public:
  explicit CommunicatorExchange(const py::object& communicator)
      : transport_(communicator), exchange_(transport_) {}
  CommunicatorExchange(const CommunicatorExchange&) = delete;
  CommunicatorExchange& operator=(const CommunicatorExchange&) = delete;

  MessageExchange& exchange() { return exchange_; }
  const MessageExchange::Traffic& traffic() const { return exchange_.traffic(); }

  // That the ranks stop, as at a Ctrl-C; called by a handler of signals, in the thread of the
  // solve.
  void interrupt() { is_interrupted_ = true; }
  bool is_interrupted() const { return is_interrupted_; }

 private:
  bool is_interrupted_ = false;
  CommunicatorTransport transport_;
  MessageExchange exchange_;
};

}  // namespace sfmcpp::bindings

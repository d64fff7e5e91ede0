#include "sfmcpp/core/exchange.hpp"

namespace sfmcpp {
namespace {

class ThisProcess final : public Exchange {
 public:
  int rank() const override { return 0; }
  int num_ranks() const override { return 1; }
  void sum(std::span<double>) override {}
  void max(std::span<double>) override {}
  std::vector<double> gather(std::span<const double> values) override {
    return {values.begin(), values.end()};
  }
  std::vector<double> deliver(std::span<const double> values, std::span<const int>) override {
    return {values.begin(), values.end()};
  }
  bool agree(bool mine) override { return mine; }
};

}  // namespace

Exchange& this_process() {
  static ThisProcess alone;
  return alone;
}

}  // namespace sfmcpp

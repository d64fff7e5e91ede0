// What a method has learned from its steps, as numbers: one list of members serves saving them and
// restoring them.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "sfmcpp/core/error.hpp"
#include "sfmcpp/linear/normal_equations.hpp"

namespace sfmcpp::optim {

class Memory {
 public:
  // To be filled, or to be read.
  Memory() = default;
  explicit Memory(std::span<const double> numbers)
      : reading_(true), numbers_(numbers.begin(), numbers.end()) {}

  const std::vector<double>& numbers() const { return numbers_; }
  bool all_read() const { return next_ == numbers_.size(); }

  // Appends the value, or sets it to what was appended in its place.
  void keep(double& value) {
    if (!reading_) return numbers_.push_back(value);
    if (all_read()) throw InvalidArgument("saved numbers of a method: too few for this method");
    value = numbers_[next_++];
  }
  void keep(bool& value) {
    double number = value ? 1.0 : 0.0;
    keep(number);
    value = number != 0.0;
  }
  void keep(std::optional<double>& value) {
    bool known = value.has_value();
    keep(known);
    if (!known) return value.reset();
    if (!value) value.emplace();
    keep(*value);
  }
  void keep(std::vector<double>& values) {
    auto size = static_cast<double>(values.size());
    keep(size);
    if (reading_ && !(size >= 0.0 && size <= static_cast<double>(numbers_.size() - next_)))
      throw InvalidArgument("saved numbers of a method: not those of this method");
    values.resize(static_cast<std::size_t>(size));
    for (double& value : values) keep(value);
  }
  void keep(linear::Step& step) {
    keep(step.camera);
    keep(step.point);
  }

 private:
  bool reading_ = false;
  std::vector<double> numbers_;
  std::size_t next_ = 0;
};

}  // namespace sfmcpp::optim

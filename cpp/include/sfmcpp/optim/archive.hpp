// A run as numbers, to save it and to take it up again: one list of the members of an object serves
// both writing and reading them.
#pragma once

#include <cmath>
#include <concepts>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "sfmcpp/core/error.hpp"
#include "sfmcpp/linear/normal_equations.hpp"
#include "sfmcpp/optim/state.hpp"

namespace sfmcpp::optim {

class Archive {
 public:
  // To be filled.
  Archive() = default;
  // To be read. Steps in it are of the size of `like`.
  Archive(std::span<const double> numbers, const linear::Step& like)
      : reading_(true), numbers_(numbers.begin(), numbers.end()), like_(like) {}

  const std::vector<double>& numbers() const { return numbers_; }
  bool is_reading() const { return reading_; }
  void require_all_read() const {
    if (next_ != numbers_.size())
      throw InvalidArgument("saved numbers: too many for these options");
  }

  // Appends the value, or sets it to what was appended in its place.
  void keep(double& value) {
    if (!reading_) return numbers_.push_back(value);
    if (next_ == numbers_.size()) throw InvalidArgument("saved numbers: too few for these options");
    value = numbers_[next_++];
  }
  template <std::integral T>
  void keep(T& value) {
    auto number = static_cast<double>(value);
    keep(number);
    if (!(std::abs(number) <= kLargestWhole<T> && number == std::trunc(number))) refuse();
    value = static_cast<T>(number);
  }
  void keep(std::optional<double>& value) {
    bool known = value.has_value();
    keep(known);
    if (!known) return value.reset();
    if (!value) value.emplace();
    keep(*value);
  }
  template <class T>
  void keep(std::vector<T>& values) {
    auto size = static_cast<double>(values.size());
    keep(size);
    if (reading_ && !(size >= 0.0 && size <= static_cast<double>(numbers_.size() - next_)))
      refuse();
    values.resize(static_cast<std::size_t>(size));
    for (T& value : values) keep(value);
  }
  // One that was not yet made is restored as zeros.
  void keep(linear::Step& step) {
    keep(step.camera);
    keep(step.point);
    if (!reading_) return;
    if (step.camera.empty() && step.point.empty())
      step = {.camera = std::vector<double>(like_.camera.size()),
              .point = std::vector<double>(like_.point.size())};
    if (step.camera.size() != like_.camera.size() || step.point.size() != like_.point.size())
      refuse();
  }
  template <class T>
  requires requires(T& value, Archive& archive) { value.keep(archive); }
  void keep(T& value) { value.keep(*this); }

 private:
  // Of those that a double holds.
  template <class T>
  static constexpr double kLargestWhole = std::numeric_limits<T>::digits < 53
                                              ? double(std::numeric_limits<T>::max())
                                              : 9007199254740992.0;

  [[noreturn]] static void refuse() {
    throw InvalidArgument("saved numbers: not those of these options");
  }

  bool reading_ = false;
  std::vector<double> numbers_;
  linear::Step like_;
  std::size_t next_ = 0;
};

// What `object.keep` hands over.
template <class T>
std::vector<double> save(T& object) {
  Archive archive;
  object.keep(archive);
  return archive.numbers();
}

// Throws InvalidArgument for numbers of another kind of object.
template <class T>
void restore(std::span<const double> saved, const linear::Step& like, T& object) {
  Archive archive(saved, like);
  object.keep(archive);
  archive.require_all_read();
}

// Where a run stands after an iteration: one of the same model and the same options that starts
// from it goes on with the bits of one that did not stop. Each rank has its own.
struct Resumption {
  State state;
  std::vector<double> numbers;  // history, and what the method and the linear solver have learned
  double seconds = 0.0;         // that the run has taken
};

}  // namespace sfmcpp::optim

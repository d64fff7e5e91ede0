#include "sfmcpp/residuals/loss.hpp"

#include <algorithm>
#include <cmath>

#include "sfmcpp/core/error.hpp"

namespace sfmcpp {

LossTable::LossTable(std::string name, std::vector<double> knots, std::vector<double> coefficients)
    : name_(std::move(name)), knots_(std::move(knots)), coefficients_(std::move(coefficients)) {
  const bool fits = knots_.size() > 1 && coefficients_.size() == kTerms * (knots_.size() - 1);
  const auto falls = [](double a, double b) { return !(a < b); };
  if (!fits || knots_[0] != 0.0 || !std::isfinite(knots_.back()) ||
      std::adjacent_find(knots_.begin(), knots_.end(), falls) != knots_.end()) {
    throw InvalidArgument("knots: must rise from zero, with " + std::to_string(kTerms) +
                          " coefficients between each two");
  }
  check_weights();
  rho_.push_back(0.0);
  for (std::size_t k = 0; k + 1 < knots_.size(); ++k)
    rho_.push_back(rho_[k] +
                   integral_to({&coefficients_[kTerms * k], 1.0, knots_[k + 1] - knots_[k]}));
}

// With a negative weight more error would be less cost. Where ρ′ is zero rounding may make it less.
void LossTable::check_weights() const {
  constexpr int kPlaces = 8;
  // Of the largest term of a cell; and of the table, about which a function that falls to nothing
  // within a cell may swing.
  constexpr double kRounding = 1e-9, kRoundingOfTable = 1e-13;
  double largest_of_all = 0.0;
  for (std::size_t k = 0; k < coefficients_.size(); ++k) {
    if (!std::isfinite(coefficients_[k])) refuse(entry("coefficients", k), "must be finite");
    largest_of_all = std::max(largest_of_all, std::abs(coefficients_[k]));
  }
  for (std::size_t k = 0; k + 1 < knots_.size(); ++k) {
    const double* cell = &coefficients_[kTerms * k];
    const double width = knots_[k + 1] - knots_[k];
    double largest = 0.0;
    for (int i = 0; i < kTerms; ++i) largest = std::max(largest, std::abs(cell[i]));
    const double rounding = std::max(kRounding * largest, kRoundingOfTable * largest_of_all);
    for (int place = 0; place <= kPlaces; ++place) {
      const double x = static_cast<double>(place) / kPlaces, weight = value_at({cell, x, width});
      if (weight >= -rounding) continue;
      refuse("coefficients: derivative " + std::to_string(weight) + " at " +
                 std::to_string(knots_[k] + x * width),
             "must not be negative");
    }
  }
}

// The end of the last cell for an s beyond the last knot. What is no number stays so in x.
LossTable::Place LossTable::place_of(double s) const {
  const auto next = std::upper_bound(knots_.begin() + 1, knots_.end() - 1, s);
  const auto k = static_cast<std::size_t>(next - knots_.begin()) - 1;
  const double width = knots_[k + 1] - knots_[k];
  return {&coefficients_[kTerms * k], std::min((s - knots_[k]) / width, 1.0), width};
}

double LossTable::value_at(const Place& place) {
  double value = 0.0;
  for (int i = kTerms - 1; i >= 0; --i) value = value * place.x + place.coefficients[i];
  return value;
}

double LossTable::integral_to(const Place& place) {
  double value = 0.0;
  for (int i = kTerms - 1; i >= 0; --i) value = value * place.x + place.coefficients[i] / (i + 1);
  return value * place.x * place.width;
}

double LossTable::rho(double s) const {
  const Place place = place_of(s);
  const auto k = static_cast<std::size_t>(place.coefficients - coefficients_.data()) / kTerms;
  const double beyond = std::max(s - knots_.back(), 0.0);
  const double slope = std::max(value_at(place), 0.0);  // as derivative() has it
  return rho_[k] + integral_to(place) + (beyond > 0.0 ? beyond * slope : 0.0);
}

// Where ρ′ is zero the polynomial may be less by its rounding.
double LossTable::derivative(double s) const { return std::max(value_at(place_of(s)), 0.0); }

double LossTable::influence_slope(double s) const {
  const Place place = place_of(s);
  double slope = 0.0;
  for (int i = kTerms - 1; i > 0; --i) slope = slope * place.x + i * place.coefficients[i];
  return value_at(place) + (s < knots_.back() ? s * slope / place.width : 0.0);
}

}  // namespace sfmcpp

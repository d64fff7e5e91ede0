// A robust loss whose derivative is a table: polynomials of s between knots, and ρ their integral.
// It has the unit scale; Loss scales it.
#pragma once

#include <string>
#include <vector>

namespace sfmcpp {

class LossTable {
 public:
  static constexpr int kTerms = 8;

  // ρ′ between knot k and the next is Σ coefficients[k][i] xⁱ, x from 0 to 1; kTerms of each. Knots
  // rise from zero; beyond the last ρ′ stays what it is there. Throws InvalidArgument if sizes do
  // not fit or knots do not rise.
  LossTable(std::string name, std::vector<double> knots, std::vector<double> coefficients);

  const std::string& name() const { return name_; }
  double rho(double s) const;
  double derivative(double s) const;
  double influence_slope(double s) const;  // d(s ρ′)/ds

 private:
  // Where s is in the table.
  struct Place {
    const double* coefficients;
    double x, width;
  };
  Place place_of(double s) const;
  static double value_at(const Place& place);
  static double integral_to(const Place& place);

  std::string name_;
  std::vector<double> knots_, coefficients_;
  std::vector<double> rho_;  // at the knots
};

}  // namespace sfmcpp

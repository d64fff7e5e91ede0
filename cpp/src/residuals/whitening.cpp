#include "sfmcpp/residuals/whitening.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>

#include "sfmcpp/core/error.hpp"

namespace sfmcpp::residuals {
namespace {

// A correlation nearer to 1 is rounding, and so would be the residual.
constexpr double kLeastIndependence = 1e-12;
constexpr double kMostAsymmetry = 1e-9;

// Entries of Σ; those off the diagonal differ by rounding at most.
struct Covariance {
  double uu, uv, vv;

  explicit Covariance(const double* c) : uu(c[0]), uv(0.5 * (c[1] + c[2])), vv(c[3]) {}

  double variance_of_v_given_u() const { return vv - uv / uu * uv; }
};

// Of two rows, of u and of v, the second turns into what L gives.
void whiten_rows(double shear, double stretch, int width, double* rows) {
  for (int k = 0; k < width; ++k) rows[width + k] = shear * rows[k] + stretch * rows[width + k];
}

// "symmetric", say, or null.
const char* rule_broken_by(const double* covariance) {
  if (!std::all_of(covariance, covariance + 4, [](double x) { return std::isfinite(x); }))
    return "finite";
  const Covariance c(covariance);
  const double size = std::sqrt(std::abs(c.uu)) * std::sqrt(std::abs(c.vv));
  if (std::abs(covariance[1] - covariance[2]) > kMostAsymmetry * size) return "symmetric";
  const bool positive = c.uu > 0.0 && c.variance_of_v_given_u() > kLeastIndependence * c.vv;
  return positive && c.vv > 0.0 ? nullptr : "positive definite";
}

}  // namespace

Whitener whitener_of(const double* covariance) {
  const Covariance c(covariance);
  const double sigma_u = std::sqrt(c.uu);
  const double stretch = sigma_u / std::sqrt(c.variance_of_v_given_u());
  return {1.0 / sigma_u, -c.uv / c.uu * stretch, stretch};
}

Whitener whitener_of(std::span<const double> sigma_px,
                     std::span<const double> covariance_px2,
                     std::size_t k) {
  if (!covariance_px2.empty()) return whitener_of(covariance_px2.data() + 4 * k);
  return {sigma_px.empty() ? 1.0 : 1.0 / sigma_px[k]};
}

void check_covariances(std::span<const double> sigma_px,
                       std::span<const double> covariance_px2,
                       std::size_t count) {
  if (covariance_px2.empty()) return;
  if (!sigma_px.empty())
    throw InvalidArgument("covariance_px2: given beside sigma_px, must be one of them");
  if (covariance_px2.size() != 4 * count) {
    throw InvalidArgument("covariance_px2: " + std::to_string(covariance_px2.size()) +
                          " values, must be " + std::to_string(4 * count));
  }
  for (std::size_t k = 0; k < count; ++k) {
    const double* c = covariance_px2.data() + 4 * k;
    if (const char* rule = rule_broken_by(c)) {
      char text[160];
      std::snprintf(text,
                    sizeof text,
                    "covariance_px2[%zu] = [[%.9g, %.9g], [%.9g, %.9g]]: must be %s",
                    k,
                    c[0],
                    c[1],
                    c[2],
                    c[3],
                    rule);
      throw InvalidArgument(text);
    }
  }
}

Whiteners::Whiteners(std::span<const double> sigma_px,
                     std::span<const double> covariance_px2,
                     std::span<const int> source,
                     int ahead)
    : inverse_sigma(source.size() + ahead, 1.0) {
  if (!covariance_px2.empty()) {
    shear.assign(inverse_sigma.size(), 0.0);
    stretch.assign(inverse_sigma.size(), 1.0);
  }
  bool round = true;
  for (std::size_t i = 0; i < source.size(); ++i) {
    const Whitener w = whitener_of(sigma_px, covariance_px2, static_cast<std::size_t>(source[i]));
    inverse_sigma[i] = w.inverse_sigma;
    if (covariance_px2.empty()) continue;
    shear[i] = w.shear;
    stretch[i] = w.stretch;
    round = round && w.shear == 0.0 && w.stretch == 1.0;
  }
  if (round) shear = stretch = {};
}

WhitenerShapes Whiteners::shapes_from(std::ptrdiff_t first) const {
  if (shear.empty()) return {};
  return {shear.data() + first, stretch.data() + first};
}

void whiten(const WhitenerShapes& shapes, int count, const double* ru, double* rv) {
  if (shapes.shear == nullptr) return;
  for (int k = 0; k < count; ++k) rv[k] = shapes.shear[k] * ru[k] + shapes.stretch[k] * rv[k];
}

void whiten(const WhitenerShapes& shapes, int count, const JacobianOutput& jacobian) {
  if (shapes.shear == nullptr) return;
  for (long k = 0; k < count; ++k) {
    const double shear = shapes.shear[k], stretch = shapes.stretch[k];
    const int width = jacobian.camera_size;
    whiten_rows(shear, stretch, width, jacobian.camera + 2 * width * k);
    whiten_rows(shear, stretch, kRecordRow, jacobian.point + kRecordSize * k);
  }
}

}  // namespace sfmcpp::residuals

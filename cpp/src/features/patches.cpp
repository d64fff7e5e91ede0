#include "sfmcpp/features/patches.hpp"

#include <algorithm>
#include <cmath>

namespace sfmcpp::features {
namespace {

// Standard deviation of the window over the radius: what is far from the centre lies in the plane
// of the patch less often.
constexpr double kWindow = 0.6;
constexpr int kIterations = 10;
// In samples: when it rests, how far one iteration may go, and how far all of them.
constexpr double kRest = 0.01, kLongestStep = 1.0, kLongestWay = 2.5;
// Of grey levels of 256, and of the smaller eigenvalue of the information (of unit variance).
constexpr double kLeastDeviation = 0.5, kLeastInformation = 1e-3;
constexpr double kLeastCorrelation = 0.3;
// Between pixels, bilinear samples have (2/3)² of the variance of their noise in the mean, and
// share what noise they have with their neighbours.
constexpr double kInterpolation = 2.25;

struct Position {
  double x, y;
};

Position position(const PatchPlace& place, double column, double row) {
  const double scale = 1.0 / (1 << place.level);
  return {(place.centre[0] - 0.5 + place.step[0] * column + place.step[1] * row) * scale,
          (place.centre[1] - 0.5 + place.step[2] * column + place.step[3] * row) * scale};
}

bool is_inside(const GreyLevel& image, const PatchPlace& place, int radius) {
  for (const int column : {-radius, radius}) {
    for (const int row : {-radius, radius}) {
      const auto [x, y] = position(place, column, row);
      // Written so that what is not a number is outside.
      if (!(x >= 0 && y >= 0 && x < image.width - 1 && y < image.height - 1)) return false;
    }
  }
  return true;
}

float interpolated(const GreyLevel& image, Position at) {
  // Rounding of what is just inside may put it on the last row.
  const int column = std::min(static_cast<int>(at.x), image.width - 2);
  const int row = std::min(static_cast<int>(at.y), image.height - 2);
  const auto a = static_cast<float>(at.x - column), b = static_cast<float>(at.y - row);
  const float* upper = image.pixels + static_cast<long>(row) * image.width + column;
  const float* lower = upper + image.width;
  const float above = upper[0] + a * (upper[1] - upper[0]);
  const float below = lower[0] + a * (lower[1] - lower[0]);
  return above + b * (below - above);
}

}  // namespace

bool sample_patch(Pyramid pyramid, const PatchPlace& place, int radius, float* samples) {
  const GreyLevel& image = pyramid[place.level];
  if (!is_inside(image, place, radius)) return false;
  for (int row = -radius; row <= radius; ++row) {
    for (int column = -radius; column <= radius; ++column)
      *samples++ = interpolated(image, position(place, column, row));
  }
  return true;
}

PatchAligner::PatchAligner(int radius) : radius_(radius) {
  const std::size_t count = static_cast<std::size_t>(patch_side(radius)) * patch_side(radius);
  const double deviation = kWindow * std::max(radius, 1);
  double sum = 0, squares = 0;
  for (int row = -radius; row <= radius; ++row) {
    for (int column = -radius; column <= radius; ++column) {
      const double weight = std::exp(-(row * row + column * column) / (2 * deviation * deviation));
      window_.push_back(static_cast<float>(weight));
      sum += weight;
      squares += weight * weight;
    }
  }
  for (float& weight : window_) weight = static_cast<float>(weight / sum);
  effective_samples_ = sum * sum / squares;
  for (auto* samples : {&template_, &patch_, &gradient_x_, &gradient_y_}) samples->resize(count);
}

bool PatchAligner::normalise(std::vector<float>& samples, double* deviation) const {
  double mean = 0, square = 0;
  for (std::size_t k = 0; k < samples.size(); ++k) mean += window_[k] * samples[k];
  for (std::size_t k = 0; k < samples.size(); ++k) {
    samples[k] -= static_cast<float>(mean);
    square += window_[k] * samples[k] * samples[k];
  }
  *deviation = std::sqrt(square);
  if (!(*deviation >= kLeastDeviation)) return false;
  for (float& sample : samples) sample = static_cast<float>(sample / *deviation);
  return true;
}

bool PatchAligner::take_template(const float* templ) {
  const int side = patch_side(radius_);
  for (int row = 0; row < side; ++row)
    std::copy_n(templ + (row + 1) * (side + 2) + 1, side, template_.begin() + row * side);
  double deviation = 0;
  if (!normalise(template_, &deviation)) return false;
  take_gradients(templ, 0.5 / deviation);
  return take_information();
}

void PatchAligner::take_gradients(const float* templ, double scale) {
  const int side = patch_side(radius_), wide = side + 2;
  for (int row = 0; row < side; ++row) {
    for (int column = 0; column < side; ++column) {
      const float* at = templ + (row + 1) * wide + column + 1;
      gradient_x_[row * side + column] = static_cast<float>(scale * (at[1] - at[-1]));
      gradient_y_[row * side + column] = static_cast<float>(scale * (at[wide] - at[-wide]));
    }
  }
  // Free of what gain and offset explain.
  for (auto* gradient : {&gradient_x_, &gradient_y_}) {
    double mean = 0, product = 0;
    for (std::size_t k = 0; k < gradient->size(); ++k) {
      mean += window_[k] * (*gradient)[k];
      product += window_[k] * (*gradient)[k] * template_[k];
    }
    for (std::size_t k = 0; k < gradient->size(); ++k)
      (*gradient)[k] -= static_cast<float>(mean + product * template_[k]);
  }
}

bool PatchAligner::take_information() {
  information_ = {};
  for (std::size_t k = 0; k < template_.size(); ++k) {
    information_[0] += window_[k] * gradient_x_[k] * gradient_x_[k];
    information_[1] += window_[k] * gradient_x_[k] * gradient_y_[k];
    information_[2] += window_[k] * gradient_y_[k] * gradient_y_[k];
  }
  const auto [a, b, c] = information_;
  if (!((a + c) / 2 - std::hypot((a - c) / 2, b) >= kLeastInformation)) return false;
  const double determinant = a * c - b * b;
  inverse_ = {c / determinant, -b / determinant, a / determinant};
  return true;
}

double PatchAligner::correlation() const {
  double sum = 0;
  for (std::size_t k = 0; k < patch_.size(); ++k) sum += window_[k] * patch_[k] * template_[k];
  return sum;
}

PatchAligner::Pair PatchAligner::offset(double correlation) const {
  const double gain = 1 / std::max(correlation, kLeastCorrelation);
  Pair slope;
  for (std::size_t k = 0; k < patch_.size(); ++k) {
    const double weighted = window_[k] * (gain * patch_[k] - template_[k]);
    slope.x += weighted * gradient_x_[k];
    slope.y += weighted * gradient_y_[k];
  }
  return {inverse_[0] * slope.x + inverse_[1] * slope.y,
          inverse_[1] * slope.x + inverse_[2] * slope.y};
}

Alignment PatchAligner::align(Pyramid pyramid, const float* templ, const PatchPlace& start) {
  if (!take_template(templ)) return {};
  PatchPlace place = start;
  Pair way;
  double alike = -1, deviation = 0;
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    if (!sample_patch(pyramid, place, radius_, patch_.data())) return {};
    if (!normalise(patch_, &deviation)) return {};
    alike = correlation();
    Pair step = offset(alike);
    const double length = std::hypot(step.x, step.y);
    const double part = std::min(1.0, kLongestStep / std::max(length, kRest));
    way = {way.x - part * step.x, way.y - part * step.y};
    if (!(std::hypot(way.x, way.y) <= kLongestWay)) return {};
    place.centre = {start.centre[0] + start.step[0] * way.x + start.step[1] * way.y,
                    start.centre[1] + start.step[2] * way.x + start.step[3] * way.y};
    if (length < kRest) break;
  }
  return result(place, alike);
}

Alignment PatchAligner::result(const PatchPlace& place, double correlation) const {
  if (correlation < kLeastCorrelation) return {};
  const double square = std::min(correlation * correlation, 1.0);
  const double variance = kInterpolation * (1 - square) / square / effective_samples_;
  const auto [a, b, c, d] = place.step;
  const auto [xx, xy, yy] = inverse_;
  return {place.centre,
          correlation,
          {variance * (a * a * xx + 2 * a * b * xy + b * b * yy),
           variance * (a * c * xx + (a * d + b * c) * xy + b * d * yy),
           variance * (c * c * xx + 2 * c * d * xy + d * d * yy)}};
}

}  // namespace sfmcpp::features

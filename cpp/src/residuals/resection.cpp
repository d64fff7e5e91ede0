#include "sfmcpp/residuals/resection.hpp"

#include <numeric>
#include <vector>

#include "sfmcpp/core/isa.hpp"

namespace sfmcpp::residuals {
namespace {

constexpr int kWidestPack = 8;

// The padding copies the first observation.
std::vector<int> padded_sources(int count, int padded) {
  std::vector<int> source(padded, 0);
  std::iota(source.begin(), source.begin() + count, 0);
  return source;
}

}  // namespace

PointViews::PointViews(std::span<const double> points,
                       std::span<const double> pixels,
                       std::span<const double> sigma_px,
                       std::span<const double> covariance_px2)
    : count_(static_cast<int>(pixels.size()) / 2),
      padded_((count_ + kWidestPack - 1) / kWidestPack * kWidestPack),
      values_(6UL * padded_),
      whiteners_(sigma_px, covariance_px2, padded_sources(count_, padded_), 0) {
  for (int i = 0; i < padded_; ++i) {
    const int source = i < count_ ? i : 0;
    for (int k = 0; k < 3; ++k) values_[k * padded_ + i] = points[3UL * source + k];
    for (int k = 0; k < 2; ++k) values_[(3 + k) * padded_ + i] = pixels[2UL * source + k];
    values_[5 * padded_ + i] = i < count_ ? whiteners_.inverse_sigma[i] : 0.0;
  }
}

ViewArrays PointViews::arrays() const {
  const auto at = [this](int k) { return values_.data() + k * padded_; };
  return {at(0), at(1), at(2), at(3), at(4), at(5), count_, padded_, whiteners_.shapes_from(0)};
}

ResectionKernels resection_kernels(CameraModelId model) {
  if (!is_metric(model)) {
    throw InvalidArgument(enum_setting(model) + ": must be a model with poses");
  }
  return SFMCPP_FOR_ACTIVE_ISA(resection_kernels_for(model));
}

}  // namespace sfmcpp::residuals

#include "sfmcpp/residuals/resection.hpp"

#include <string>

#include "sfmcpp/core/isa.hpp"
#include "sfmcpp/residuals/resection_isa.hpp"

namespace sfmcpp::residuals {
namespace {

constexpr int kWidestPack = 8;

}  // namespace

PointViews::PointViews(std::span<const double> points,
                       std::span<const double> pixels,
                       std::span<const double> sigma_px)
    : count_(static_cast<int>(pixels.size()) / 2),
      padded_((count_ + kWidestPack - 1) / kWidestPack * kWidestPack),
      values_(6UL * padded_) {
  for (int i = 0; i < padded_; ++i) {
    const int source = i < count_ ? i : 0;
    for (int k = 0; k < 3; ++k) values_[k * padded_ + i] = points[3UL * source + k];
    for (int k = 0; k < 2; ++k) values_[(3 + k) * padded_ + i] = pixels[2UL * source + k];
    const double sigma = sigma_px.empty() ? 1.0 : sigma_px[source];
    values_[5 * padded_ + i] = i < count_ ? 1.0 / sigma : 0.0;
  }
}

ViewArrays PointViews::arrays() const {
  const auto at = [this](int k) { return values_.data() + k * padded_; };
  return {at(0), at(1), at(2), at(3), at(4), at(5), count_, padded_};
}

ResectionKernels resection_kernels(CameraModelId model) {
  if (!is_metric(model)) {
    throw InvalidArgument("camera_model = '" + std::string(enum_name(model)) +
                          "': must be a model with poses");
  }
  return SFMCPP_FOR_ACTIVE_ISA(resection_kernels_for(model));
}

}  // namespace sfmcpp::residuals

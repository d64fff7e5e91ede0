// The algebraic reprojection error of a whole problem along a step: nine sums in one pass over the
// observations (thesis §4.3, residuals/algebraic.hpp). Constraints are no part of it: an algebraic
// line search proposes lengths by the images alone and chooses among them by the true cost.
#pragma once

#include <array>
#include <span>
#include <string_view>
#include <vector>

#include "sfmcpp/ba/image_residuals.hpp"
#include "sfmcpp/ba/rigs.hpp"
#include "sfmcpp/core/enum_names.hpp"
#include "sfmcpp/linear/normal_equations.hpp"
#include "sfmcpp/math/biquadratic.hpp"
#include "sfmcpp/residuals/algebraic.hpp"

namespace sfmcpp {

namespace ba {
// How observations count in the algebraic cost: all alike (thesis eq. 4.8), or by the inverse of
// their depth at the present state, so that the cost starts as the geometric one.
enum class AlgebraicWeights { kUniform, kInverseDepth };
}  // namespace ba

template <>
struct EnumTraits<ba::AlgebraicWeights> {
  static constexpr std::string_view kWhat = "algebraic_weights";
  static constexpr auto kTable = std::to_array<EnumRow<ba::AlgebraicWeights>>(
      {{ba::AlgebraicWeights::kUniform, "uniform", "all alike (thesis eq. 4.8)"},
       {ba::AlgebraicWeights::kInverseDepth,
        "inverse-depth",
        "by the inverse of their depth, so that the cost starts as the geometric one"}});
};

namespace ba {

// Isotropic normalisation of an image (thesis eq. 4.3): the centroid of its observations, and their
// mean distance to it over √2.
struct ImageNormalization {
  double centre_u = 0.0;
  double centre_v = 0.0;
  double scale = 1.0;
};

class AlgebraicCost {
 public:
  // The references must outlive this object.
  AlgebraicCost(const ImageResiduals& images,
                const linear::ParameterMap& map,
                const std::vector<int>& free_intrinsics);

  // `weights` in stored order: of the residuals, as the true cost has them at `state`; none: 1/σ_u.
  Biquadratic along(const optim::State& state,
                    const linear::Step& step,
                    std::span<const double> weights,
                    AlgebraicWeights algebraic_weights);

 private:
  struct CameraLine {
    double matrix[kCameraStorage];
    double change[kCameraStorage];
  };
  void normalize_images();
  CameraLine camera_line(const optim::State& state, const linear::Step& step, int camera) const;

  const ImageResiduals& images_;
  const Problem& problem_;
  const linear::ObservationGraph& graph_;
  const linear::ParameterMap& map_;
  const std::vector<int>& free_intrinsics_;
  Frames frames_;
  residuals::AlgebraicKernel kernel_;
  std::vector<ImageNormalization> normalizations_;  // of each image, once it is asked for
};

}  // namespace ba
}  // namespace sfmcpp

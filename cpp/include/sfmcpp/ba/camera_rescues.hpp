// New searches for cameras most of whose views a robust loss rejects as outliers.
//
// A camera that is far off when the scale has fallen keeps few inliers and stays in a minimum of
// some wrong ones. Given the points each camera is a problem of its own: it is fitted with a scale
// many times the last, which falls again, and the result is kept where its own views cost less.
#pragma once

#include <vector>

#include "sfmcpp/ba/image_residuals.hpp"
#include "sfmcpp/linear/parameter_map.hpp"

namespace sfmcpp::ba {

class CameraRescues {
 public:
  // The references must outlive this object. `free_intrinsics` as in mask.hpp.
  CameraRescues(const ImageResiduals& images,
                const linear::ParameterMap& map,
                const std::vector<int>& free_intrinsics)
      : images_(images), map_(map), free_intrinsics_(free_intrinsics) {}

  // Moves such cameras, and intrinsics that no other camera has, under a loss that is bounded; how
  // many. None of rigs, in a projective world, or of a camera model that is a function.
  long rescue(const optim::State& start, optim::State& state) const;

 private:
  bool is_possible() const;

  const ImageResiduals& images_;
  const linear::ParameterMap& map_;
  const std::vector<int>& free_intrinsics_;
};

}  // namespace sfmcpp::ba

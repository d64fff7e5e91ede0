// Points that most of their views have nothing to do with are looked for anew.
//
// A loss that lets go of what is far off lets go of all views of a point that outliers have led
// away, and nothing brings it back. Given the cameras each such point is a problem of its own:
// places are tried where the rays of two of its views meet (Fischler & Bolles 1981) and a third
// view agrees, and the one that costs least is taken if that saves a tenth of what a view let go of
// costs.
#pragma once

#include "sfmcpp/ba/image_residuals.hpp"
#include "sfmcpp/linear/parameter_map.hpp"

namespace sfmcpp::ba {

class PointRescues {
 public:
  // The references must outlive this object.
  PointRescues(const ImageResiduals& images, const linear::ParameterMap& map)
      : images_(images), map_(map) {}

  // Moves such points, under a loss that is bounded; how many, over all ranks. None in a projective
  // world, whose rays have no front.
  long rescue(optim::State& state) const;

 private:
  const ImageResiduals& images_;
  const linear::ParameterMap& map_;
};

}  // namespace sfmcpp::ba

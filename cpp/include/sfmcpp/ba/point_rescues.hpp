// Points that most of their views have nothing to do with are looked for anew.
//
// A loss that lets go of what is far off lets go of all views of a point that outliers have led
// away, and nothing brings it back. Given the cameras each such point is a problem of its own:
// places are tried where the rays of two of its views meet (Fischler & Bolles 1981) and a third
// view agrees, and the one that costs least is taken if that saves a tenth of what a view let go of
// costs.
#pragma once

#include <vector>

#include "sfmcpp/ba/image_residuals.hpp"

namespace sfmcpp::ba {

// Of what a view that is let go of costs: what looking anew for a point or a camera has to save.
inline constexpr double kLeastRescueGain = 0.1;

class PointRescues {
 public:
  // The references must outlive this object. `movable`: per point, whether it is one of these.
  PointRescues(const ImageResiduals& images, const std::vector<char>& movable)
      : images_(images), movable_(movable) {}

  // Moves such points, under a loss that is bounded; how many, over all ranks. None in a projective
  // world, whose rays have no front.
  long rescue(optim::State& state) const;

 private:
  const ImageResiduals& images_;
  const std::vector<char>& movable_;
};

}  // namespace sfmcpp::ba

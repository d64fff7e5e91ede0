// New searches for points most of whose views a robust loss rejects as outliers.
//
// A loss that rejects what is far off rejects all views of a point that outliers have led away, and
// no gradient brings it back. Given the cameras each such point is a problem of its own: places are
// tried where the rays of two of its views meet (Fischler & Bolles 1981) and a third view agrees,
// and the one that costs least is taken if that saves a tenth of what a rejected view costs.
#pragma once

#include <vector>

#include "sfmcpp/ba/image_residuals.hpp"

namespace sfmcpp::ba {

// Share of what a rejected view costs: a new search for a point or a camera has to save so much.
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

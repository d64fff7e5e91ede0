// Points that a step has taken beyond its linear model are fitted to the cameras where it has
// brought them, before the step is judged: embedded point iterations (Jeong, Nistér, Steedly,
// Szeliski & Kweon 2012, "Pushing the envelope of modern methods for bundle adjustment"), of these
// points alone.
//
// The model fails first for points seen under a small angle: they are thrown along their rays, and
// what they then cost holds back the cameras. Given the cameras each is a problem of three
// unknowns. A step δ moves the images of a point by √(δᵀVδ) in all; of that, as much is of second
// order as the point has moved beside its distance. With tr V = 2n f²/z² for n images at a distance
// z that is |δ| √(tr V / 2n) / f, in radians. Weights of a robust loss change with every move.
//
// From behind a camera or beyond infinity no fit brings a point back, as its cost falls towards
// infinity on that side. So each is fitted from the best of several places.
#pragma once

#include <vector>

#include "sfmcpp/ba/point_lanes.hpp"
#include "sfmcpp/linear/normal_equations.hpp"

namespace sfmcpp::ba {

class PointRefits {
 public:
  // The references must outlive this object. `movable`: per point, whether it is one of these.
  PointRefits(const ImageResiduals& images, const std::vector<char>& movable);

  // Fits such points of the candidate of `step`, a step from `start`, where `normal` was filled.
  // Those that fit poorly where it has brought them are fitted from where they were if they cost
  // less there, and those that then fit poorly from where their rays meet, too. None costs more
  // than before. How many there are, over all ranks: those for which the second order matters
  // beside what one point has of `cost`.
  long refit(const optim::State& start,
             const linear::NormalEquations& normal,
             const linear::Step& step,
             double cost,
             optim::State& candidate);

 private:
  void mark_beyond_model(const linear::NormalEquations& normal,
                         const linear::Step& step,
                         double least,
                         double focal2);
  double mean_squared_focal(const optim::State& state) const;

  const ImageResiduals& images_;
  const std::vector<char>& movable_;
  PointLanesOfThreads lanes_;
  double inverse_variance_;  // mean of 1/σ²
  // Of each point: passes in a row in which its step has failed, plus one; 0 where it is at rest.
  std::vector<char> tries_;
  std::vector<char> poor_;                 // which still fit poorly, of those of the first pass
  std::vector<int> points_, poor_points_;  // of a pass, and of the last one
};

}  // namespace sfmcpp::ba

// The scale of loss 'auto': as far as residuals are more than the background of outliers.
//
// Far from a minimum good observations have large residuals, and a loss that lets go of these never
// comes near. So the scale begins where the residuals of the start tell outliers from the rest, and
// falls as the rest comes closer: graduated non-convexity (Blake & Zisserman 1987; Black &
// Rangarajan 1996; Yang, Antonante, Tzoumas & Carlone 2020), with the stages told by the data.
//
// Where the right residuals have long tails, a scale that keeps them also keeps pairs of wrong
// observations that agree by chance, and these hold the cameras off for good. So it falls to the
// bulk of the residuals first, and rises to their tails once the cameras are right.
#pragma once

#include "sfmcpp/ba/image_residuals.hpp"

namespace sfmcpp::ba {

class FallingScale {
 public:
  // Outliers are taken to lie around the image of a point as the observations of an image lie
  // around each other. The scale does not fall below `least`. The reference must outlive this
  // object.
  FallingScale(const ImageResiduals& images, double least);

  double at(const optim::State& state) const;
  // The scale that follows `scale`; itself where it has come to the bulk of the residuals, or where
  // it lets go of none.
  double after(double scale, const optim::State& state) const;
  // Whether no residual is beyond `scale`.
  bool keeps_all(double scale, const optim::State& state) const;
  // No smaller than `scale`, to which it has fallen: as far as residuals are much denser than
  // outliers.
  double last(double scale, const optim::State& state) const;

 private:
  const ImageResiduals& images_;
  double least_;
  double area_;  // of the images, in squared standard deviations
};

}  // namespace sfmcpp::ba

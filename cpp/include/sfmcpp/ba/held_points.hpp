// Step lengths of their own for points that a step makes worse.
//
// Given the cameras the points are independent of each other, and one among millions that steps
// through the plane of a camera can cost more than all others have gained: λ would then follow that
// point, or the step be rejected for all. It need not spoil the step of the others: it is drawn
// back along its own step until it costs no more than before.
#pragma once

#include <vector>

#include "sfmcpp/ba/point_lanes.hpp"

namespace sfmcpp::ba {

class HeldPoints {
 public:
  // The references must outlive this object. `movable`: per point, whether it is one of these.
  // `by_camera`: whether growth() is of cameras, whose points any rank may have, or of chunks.
  HeldPoints(const ImageResiduals& images, const std::vector<char>& movable, bool by_camera)
      : images_(images), movable_(movable), by_camera_(by_camera), lanes_(images) {}

  // Where the costs of the chunks are to be written: at the state where a step starts, and at its
  // candidate.
  std::vector<double>* at_start() { return &start_; }
  std::vector<double>* at_candidate() { return &candidate_; }

  // What the chunks (or cameras) that cost more at the candidate cost more there, over all ranks:
  // most points that matter show in it, without a look at any observation.
  double growth() const;
  // Draws back points of `candidate` that cost more there than at `start`; how many, over all
  // ranks. Only points with an observation that makes a ten-thousandth of the growth are looked at:
  // the others do not matter.
  long hold_back(const optim::State& start, optim::State& candidate);

 private:
  double growth_of_cameras() const;
  void find_suspects(const optim::State& start, const optim::State& candidate);
  void suspect(const optim::State& start, const optim::State& candidate, int chunk, double least);

  const ImageResiduals& images_;
  const std::vector<char>& movable_;
  bool by_camera_;
  PointLanesOfThreads lanes_;
  std::vector<double> start_, candidate_;                 // of each chunk
  mutable std::vector<CompensatedSum> costs_of_cameras_;  // at the start, then at the candidate
  std::vector<char> suspected_;                           // of each point
  std::vector<int> suspects_;
};

}  // namespace sfmcpp::ba

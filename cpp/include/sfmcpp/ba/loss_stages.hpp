// The stages of loss 'auto': what cost is minimised next, and from where.
//
// The scale falls and rises (FallingScale), points are searched for anew (point_rescues.hpp),
// and then detours are made: an observation just beyond the scale of the loss has no influence,
// though its point and its camera could come to agree with it together. At twice the scale it has;
// the detour is kept if the cost is lower back at the scale. At last cameras are searched for anew
// (camera_rescues.hpp), judged in the same way.
#pragma once

#include <optional>

#include "sfmcpp/ba/camera_rescues.hpp"
#include "sfmcpp/ba/image_residuals.hpp"
#include "sfmcpp/ba/point_rescues.hpp"
#include "sfmcpp/optim/archive.hpp"

namespace sfmcpp::ba {

// Of a scale that residuals tell. Exact data has no spread to learn from; any positive scale then
// leaves every residual alone.
inline constexpr double kLeastLossScale = 1e-9;

// The scale of loss 'auto': the size up to which residuals are denser than the background of
// outliers.
//
// Far from a minimum good observations have large residuals, and a loss that rejects these never
// comes near. So the scale begins where the residuals of the start tell outliers from the rest, and
// falls as the rest comes closer: graduated non-convexity (Blake & Zisserman 1987; Black &
// Rangarajan 1996; Yang, Antonante, Tzoumas & Carlone 2020), with the stages determined by the
// data.
//
// Where the right residuals have long tails, a scale that keeps them also keeps pairs of wrong
// observations that agree by chance, and these hold the cameras off for good. So it falls to the
// bulk of the residuals first, and rises to their tails once the cameras are right.
class FallingScale {
 public:
  // Outliers are taken to lie around the image of a point as the observations of an image lie
  // around each other. The scale does not fall below `least`. The reference must outlive this
  // object.
  FallingScale(const ImageResiduals& images, double least);

  double at(const optim::State& state) const;
  // The scale that follows `scale`; itself where it has come to the bulk of the residuals, or where
  // it lets go of none and none is larger than noise.
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

// Where a detour began.
struct LeftMinimum {
  optim::State state;
  double cost = 0.0;

  void keep(optim::Archive& archive);
};

class LossStages {
 public:
  // Gives the images their loss, now and in each stage. The references but that to the start must
  // outlive this object.
  LossStages(ImageResiduals& images,
             const PointRescues& points,
             const CameraRescues& cameras,
             const optim::State& start,
             double least);

  // As those of optim::LeastSquaresModel.
  bool sharpen(optim::State& state);
  bool leave(optim::State& state, double cost);
  bool come_back(optim::State& state);
  void keep(optim::Archive& archive);

 private:
  // How often points are looked for anew, once the scale moves no more: the cameras move once these
  // are found. After a detour once.
  static constexpr int kRescues = 3;
  // Detours: those at twice the scale come before those to cameras.
  static constexpr int kWideDetours = 3;
  static constexpr int kDetours = 6;

  void set_scale(double scale) { images_.set_loss({LossKind::kAuto, scale}); }
  bool move_scale(const optim::State& state);
  bool set_out(optim::State& state);
  void go_back(optim::State& state);
  // Leaves out what is left of the detours of the last one's kind.
  void end_kind() { detours_ = detours_ <= kWideDetours ? kWideDetours : kDetours; }

  ImageResiduals& images_;
  const PointRescues& points_;
  const CameraRescues& cameras_;
  const optim::State start_;
  FallingScale falling_scale_;
  bool scale_moves_ = true;
  int rescues_left_ = kRescues;
  int detours_ = 0;  // begun
  bool is_wide_ = false;
  std::optional<LeftMinimum> minimum_;
};

}  // namespace sfmcpp::ba

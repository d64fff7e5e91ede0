// The stages of loss 'auto': what cost is minimised next, and from where.
//
// The scale falls and rises (falling_scale.hpp), points are looked for anew (point_rescues.hpp),
// and then detours are made: an observation just beyond the reach of the loss draws nothing, though
// its point and its camera would come to agree with it together. At twice the scale it does;
// whether that was worth it the cost tells, back at the scale. At last cameras are looked for anew
// (camera_rescues.hpp), judged in the same way.
#pragma once

#include <optional>

#include "sfmcpp/ba/camera_rescues.hpp"
#include "sfmcpp/ba/falling_scale.hpp"
#include "sfmcpp/ba/image_residuals.hpp"
#include "sfmcpp/ba/point_rescues.hpp"
#include "sfmcpp/optim/memory.hpp"

namespace sfmcpp::ba {

// Where a detour began.
struct LeftMinimum {
  optim::State state;
  double cost = 0.0;

  void keep(optim::Memory& memory);
};

class LossStages {
 public:
  // Gives the images their loss, now and in each stage. The references but
  // that to the start must outlive this object.
  LossStages(ImageResiduals& images,
             const PointRescues& points,
             const CameraRescues& cameras,
             const optim::State& start,
             double least);

  // As those of optim::LeastSquaresModel.
  bool sharpen(optim::State& state);
  bool leave(optim::State& state, double cost);
  bool come_back(optim::State& state);
  void keep(optim::Memory& memory);

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

// The stages of loss 'auto': what cost is minimised next, and from where.
//
// The scale falls and rises (falling_scale.hpp), points are looked for anew (point_rescues.hpp),
// and then detours are made: an observation just beyond the reach of the loss draws nothing, though
// its point and its camera would come to agree with it together. At twice the scale it does;
// whether that was worth it the cost tells, back at the scale.
#pragma once

#include <optional>

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
  // Gives the images their loss, now and in each stage. The references must outlive this object.
  LossStages(ImageResiduals& images,
             const PointRescues& rescues,
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
  static constexpr int kDetours = 3;

  void set_scale(double scale) { images_.set_loss({LossKind::kAuto, scale}); }
  bool move_scale(const optim::State& state);
  void go_back(optim::State& state);

  ImageResiduals& images_;
  const PointRescues& rescues_;
  FallingScale falling_scale_;
  bool scale_moves_ = true;
  int rescues_left_ = kRescues;
  int detours_left_ = kDetours;
  bool is_wide_ = false;
  std::optional<LeftMinimum> minimum_;
};

}  // namespace sfmcpp::ba

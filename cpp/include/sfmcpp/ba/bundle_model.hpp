// Bundle adjustment as a least-squares model: where residuals and linear algebra meet.
#pragma once

#include <optional>
#include <vector>

#include "sfmcpp/ba/algebraic_cost.hpp"
#include "sfmcpp/ba/bending.hpp"
#include "sfmcpp/ba/constraint_terms.hpp"
#include "sfmcpp/ba/held_points.hpp"
#include "sfmcpp/ba/image_residuals.hpp"
#include "sfmcpp/ba/late_intrinsics.hpp"
#include "sfmcpp/ba/loss_stages.hpp"
#include "sfmcpp/ba/point_refits.hpp"
#include "sfmcpp/ba/point_rescues.hpp"
#include "sfmcpp/ba/rigs.hpp"
#include "sfmcpp/linear/normal_equations.hpp"
#include "sfmcpp/optim/model.hpp"

namespace sfmcpp::ba {

class BundleModel final : public optim::LeastSquaresModel {
 public:
  // The references must outlive the model, the constraints of the problem too. `rows`: on points,
  // which the map knows. `free_intrinsics` as in mask.hpp; `stored`: how the Jacobian is, not auto;
  // `compensated`: see normal_equations.hpp.
  BundleModel(const Problem& problem,
              const linear::ObservationGraph& graph,
              PointRows& rows,
              const linear::ParameterMap& map,
              std::vector<int> free_intrinsics,
              ThreadPool& pool,
              Exchange& exchange = this_process(),
              linear::Precision stored = linear::Precision::kDouble,
              bool compensated = false);
  BundleModel(const BundleModel&) = delete;
  BundleModel& operator=(const BundleModel&) = delete;

  void set_loss(const Loss& loss);
  // Loss 'auto': of the residuals at `start` now, of those of later states once they are smaller.
  void let_scale_fall(const optim::State& start, double least);
  // Whether the linear solver wants modes of the cameras with each linearisation.
  void set_camera_modes_wanted(bool wanted) { modes_wanted_ = wanted; }
  void set_algebraic_weights(AlgebraicWeights weights) { algebraic_weights_ = weights; }

  double cost(const optim::State& state) override;
  double linearize(const optim::State& state) override;
  const linear::NormalEquations& normal_equations() const override { return normal_; }
  void plus(const optim::State& state,
            const linear::Step& step,
            optim::StepLengths lengths,
            optim::State& result) const override;
  double size(const optim::State& state) const override;
  void normalize(optim::State& state) const override;
  double slope(const optim::State& start,
               const linear::Step& step,
               const optim::State& candidate) override;
  std::optional<Biquadratic> algebraic_cost(const optim::State& state,
                                            const linear::Step& step) override;

  std::span<const double> bending(const optim::State& state, const linear::Step& step) override;
  double growth() const override;
  long hold_back(const optim::State& start, optim::State& candidate) override;

  bool moves_intrinsics_far(const optim::State& start,
                            const optim::State& candidate) const override;
  void hold_intrinsics(bool held) override;

  bool sharpen(optim::State& state) override;
  bool leave(optim::State& state, double cost) override;
  bool come_back(optim::State& state) override;
  void keep(optim::Archive& archive) override;

  long refit(const optim::State& start,
             const linear::Step& step,
             double cost,
             optim::State& candidate) override;

  const ImageResiduals& images() const { return images_; }
  const ConstraintTerms& constraints() const { return constraints_; }
  // How well the state fitted the images where it was linearised last.
  const ImageFit& fit_where_linearized() const { return fit_; }

 private:
  void make_room_for_weights();
  residuals::JacobianOutput jacobian_output(double* camera, double* point) const;
  ChunkFit linearize_chunk(const optim::State& state, int chunk);
  int linearize_part(const optim::State& state,
                     const linear::Chunk& part,
                     double* jacobian,
                     linear::PointRecord* records) const;
  void apply_loss(const linear::Chunk& part,
                  double* jacobian,
                  linear::PointRecord* records,
                  CompensatedSum& cost);
  // Of a robust loss, in stored order, where linearised last; else empty.
  std::span<const double> weights() const;
  double chunk_slope(const optim::State& state, const linear::Step& step, int chunk) const;
  std::vector<double> transported(const optim::State& start,
                                  const linear::Step& step,
                                  const optim::State& candidate) const;
  void move_camera(const optim::State& state,
                   const linear::Step& step,
                   double length,
                   int camera,
                   optim::State& result) const;
  void move_points(const optim::State& state,
                   const linear::Step& step,
                   double length,
                   int begin,
                   int end,
                   optim::State& result) const;

  const Problem& problem_;
  const linear::ObservationGraph& graph_;
  PointRows& rows_;
  const linear::ParameterMap& map_;
  std::vector<int> free_intrinsics_;
  LateIntrinsics late_intrinsics_;
  Frames frames_;
  ThreadPool& pool_;
  Exchange& exchange_;
  ImageResiduals images_;
  std::vector<char> of_images_alone_;  // points that may move and that images alone are on
  HeldPoints held_;
  PointRefits refits_;
  PointRescues point_rescues_;
  CameraRescues camera_rescues_;
  std::optional<LossStages> loss_stages_;
  std::vector<double> weights_;  // 1/σ_u √ρ′ where linearised last, of a robust loss
  ConstraintTerms constraints_;
  linear::NormalEquations normal_;
  bool modes_wanted_ = false;
  ImageFit fit_;
  AlgebraicCost algebraic_;
  Bending bending_;
  AlgebraicWeights algebraic_weights_ = AlgebraicWeights::kUniform;
};

}  // namespace sfmcpp::ba

// Bundle adjustment as a least-squares model: where residuals and linear algebra meet.
#pragma once

#include <vector>

#include "sfmcpp/ba/problem.hpp"
#include "sfmcpp/core/parallel.hpp"
#include "sfmcpp/linear/normal_equations.hpp"
#include "sfmcpp/optim/model.hpp"
#include "sfmcpp/residuals/loss.hpp"
#include "sfmcpp/residuals/reprojection.hpp"

namespace sfmcpp::ba {

class BundleModel final : public optim::LeastSquaresModel {
 public:
  // The references must outlive the model. `free_intrinsics` as in mask.hpp.
  BundleModel(const Problem& problem,
              const linear::ObservationGraph& graph,
              const linear::ParameterMap& map,
              std::vector<int> free_intrinsics,
              ThreadPool& pool);

  void set_loss(const Loss& loss) { loss_ = loss; }

  double cost(const optim::State& state) override;
  void linearize(const optim::State& state) override;
  const linear::NormalEquations& normal_equations() const override { return normal_; }
  void plus(const optim::State& state,
            const linear::Step& step,
            optim::StepLengths lengths,
            optim::State& result) const override;

  // Residuals over σ (2 per observation), in stored order.
  std::vector<double> residuals(const optim::State& state);
  // Observations whose point is not in front of the camera.
  int num_behind_camera(const optim::State& state);

 private:
  residuals::ObservationBatch batch(const optim::State& state, const linear::Chunk& chunk) const;
  double chunk_cost(const optim::State& state, const linear::Chunk& chunk) const;
  void linearize_chunk(const optim::State& state, int chunk);
  void apply_loss(const linear::Chunk& chunk);
  void plus_camera(const optim::State& state,
                   const linear::Step& step,
                   double length,
                   int camera,
                   optim::State& result) const;

  const Problem& problem_;
  const linear::ObservationGraph& graph_;
  const linear::ParameterMap& map_;
  std::vector<int> free_intrinsics_;
  ThreadPool& pool_;
  residuals::ReprojectionKernels kernels_;
  Loss loss_;
  std::vector<double> u_, v_, inverse_sigma_;  // in stored order, readable beyond the end
  linear::NormalEquations normal_;
};

}  // namespace sfmcpp::ba

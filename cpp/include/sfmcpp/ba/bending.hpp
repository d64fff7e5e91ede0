// Second derivatives of all residuals along a step, of −r, for the geodesic acceleration
// (optim/geodesic_acceleration.hpp). One pass over the observations that does not read the
// Jacobian. Weights of a robust loss stay what they are where the step starts, as in the normal
// equations; residuals of constraints are taken to be linear, which absolute positions and
// translations are.
#pragma once

#include <span>
#include <vector>

#include "sfmcpp/ba/image_residuals.hpp"
#include "sfmcpp/ba/rigs.hpp"
#include "sfmcpp/linear/normal_equations.hpp"
#include "sfmcpp/residuals/reprojection.hpp"

namespace sfmcpp::ba {

class Bending {
 public:
  // The references must outlive this object. `rows`: pairs of rows of the normal equations, of
  // images and of functions.
  Bending(const ImageResiduals& images,
          const linear::ParameterMap& map,
          const std::vector<int>& free_intrinsics,
          int rows);

  // Two numbers per observation, in stored order, and zeros for what is no image. `weights` of the
  // residuals at `state`, of a robust loss; empty: 1/σ.
  std::span<const double> along(const optim::State& state,
                                const linear::Step& step,
                                std::span<const double> weights);

 private:
  // Calls use(c, batch) for every chunk.
  template <class F>
  void for_each_batch(const optim::State& state,
                      const linear::Step& step,
                      std::span<const double> weights,
                      const F& use) const;
  void bend_by_kernel(const residuals::BendingBatch& batch, const linear::Chunk& chunk);
  void bend_by_function(const CameraFunction& function,
                        const optim::State& state,
                        const linear::Step& step,
                        std::span<const double> weights);
  void write(const linear::Chunk& chunk, const double* u, double* v);

  const ImageResiduals& images_;
  const linear::ParameterMap& map_;
  const std::vector<int>& free_intrinsics_;
  Frames frames_;
  residuals::BendingKernel kernel_;
  std::size_t num_values_;
  AlignedVector<double> values_;
};

}  // namespace sfmcpp::ba

// The residuals of all observations, r = (observed − projected) / σ or whitened by a covariance
// (residuals/whitening.hpp), and what they cost: in stored order (linear/observation_graph.hpp), in
// parallel over its chunks. Of the observations of this rank; sums are over all ranks
// (core/exchange.hpp).
#pragma once

#include <optional>
#include <vector>

#include "sfmcpp/ba/problem.hpp"
#include "sfmcpp/core/aligned.hpp"
#include "sfmcpp/core/parallel.hpp"
#include "sfmcpp/residuals/function_images.hpp"
#include "sfmcpp/residuals/loss.hpp"
#include "sfmcpp/residuals/reprojection.hpp"
#include "sfmcpp/residuals/whitening.hpp"

namespace sfmcpp::ba {

// How well a state fits the images.
struct ImageFit {
  double cost = 0.0;            // ½ Σ ρ(‖r‖²)
  double sum_of_squares = 0.0;  // Σ ‖r‖²
  double observations = 0.0;    // how many
  double behind_camera = 0.0;   // how many are of points that are not in front of the camera

  double rms() const;  // sqrt(Σ‖r‖² / 2M), thesis eq. 3.27
};

// The same of one chunk; the cost is twice that.
struct ChunkFit {
  CompensatedSum cost;
  CompensatedSum sum_of_squares;
  double behind_camera = 0.0;
};

class ImageResiduals {
 public:
  // The references must outlive this object.
  ImageResiduals(const Problem& problem,
                 const linear::ObservationGraph& graph,
                 ThreadPool& pool,
                 Exchange& exchange = this_process());

  void set_loss(const Loss& loss) { loss_ = loss; }
  const Loss& loss() const { return loss_; }
  bool is_robust() const { return !loss_.is_squared(); }

  double rho(double squared) const { return is_robust() ? loss_.rho(squared) : squared; }
  // Two per observation.
  std::vector<double> values(const optim::State& state) const;
  // With the costs Σ ρ(‖r‖²) of the chunks, where there is room for them.
  ImageFit fit(const optim::State& state, std::vector<double>* costs = nullptr) const;
  // `of_chunk(c)` fits chunk c: their sum.
  template <class F>
  ImageFit sum_over_chunks(const F& of_chunk, std::vector<double>* costs = nullptr) const {
    fits_.resize(graph_.chunks.size());
    pool_.parallel_for(static_cast<int>(fits_.size()), [&](int c) { fits_[c] = of_chunk(c); });
    if (costs != nullptr) {
      costs->resize(fits_.size());
      for (std::size_t c = 0; c < fits_.size(); ++c) (*costs)[c] = fits_[c].cost.value();
    }
    return total();
  }
  // Whether observations may be asked for one by one, by the next two: not of a camera model that
  // is a function, whose calls are for all.
  bool single_observations() const { return !function_images_; }
  // ρ(‖r‖²) of each observation of a chunk, and ‖r‖² of one with its point at `place`.
  void observation_costs(const optim::State& state,
                         const linear::Chunk& chunk,
                         double* costs) const;
  double square_at_place(const optim::State& state, int observation, const double* place) const;

  // Goes before a pass of linearize() over the chunks: the one call of a camera model that is a
  // function. fit() and values() make theirs, with residuals alone.
  void prepare(const optim::State& state, bool with_jacobians = true) const;
  // A chunk of observations as the kernels take it, what 1/σ_u leaves to whiten in it, and its
  // residuals with their Jacobian; how many points are not in front of the camera.
  residuals::ObservationBatch batch(const optim::State& state, const linear::Chunk& chunk) const;
  residuals::WhitenerShapes shapes(const linear::Chunk& chunk) const;
  int linearize(const optim::State& state,
                const linear::Chunk& chunk,
                const residuals::JacobianOutput& out) const;
  // Adds ‖r‖² of records that linearize() wrote, in the order in which fit() does: call it part by
  // part of a chunk, with the same sums.
  void add_squares(int count, const double* records, residuals::SumOfSquares& squares) const;
  // In stored order, readable beyond the end: observed pixels.
  const AlignedVector<double>& u() const { return u_; }
  const AlignedVector<double>& v() const { return v_; }
  // Of the observations of a chunk.
  const double* inverse_sigma(const linear::Chunk& chunk) const;
  // Of 1/σ_u², over all ranks.
  double mean_inverse_variance() const;

  const Problem& problem() const { return problem_; }
  const linear::ObservationGraph& graph() const { return graph_; }
  ThreadPool& pool() const { return pool_; }
  Exchange& exchange() const { return exchange_; }

 private:
  // Two arrays with room for a chunk and kReadAhead numbers; as linearize().
  int residuals_of(const optim::State& state,
                   const linear::Chunk& chunk,
                   double* ru,
                   double* rv) const;
  void copy_pixels();
  bool is_plain() const { return !is_robust() && whiteners_.shear.empty() && !function_images_; }
  ChunkFit chunk_fit(const optim::State& state, const linear::Chunk& chunk) const;
  ImageFit total() const;

  const Problem& problem_;
  const linear::ObservationGraph& graph_;
  ThreadPool& pool_;
  Exchange& exchange_;
  residuals::ReprojectionKernels kernels_;
  residuals::CostKernels cost_kernels_;
  mutable std::optional<residuals::FunctionImages> function_images_;  // of the last pass
  mutable std::vector<ChunkFit> fits_;                                // of the last pass
  Loss loss_;
  AlignedVector<double> u_, v_;
  residuals::Whiteners whiteners_;  // empty where all observations have a σ of 1 px
};

}  // namespace sfmcpp::ba

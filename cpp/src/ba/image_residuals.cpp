#include "sfmcpp/ba/image_residuals.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace sfmcpp::ba {
namespace {

using linear::Chunk;
using optim::State;

// Residuals of a chunk.
struct ChunkResiduals {
  std::array<double, linear::kChunkSize + kReadAhead> u, v;

  double squared(int k) const { return u[k] * u[k] + v[k] * v[k]; }
};

// 1/σ of every chunk where all σ are 1 px: one copy stays in the cache.
constexpr auto kOnes = [] {
  std::array<double, linear::kChunkSize + kReadAhead> ones{};
  ones.fill(1.0);
  return ones;
}();

constexpr long kObservationsPerTask = 4096;

residuals::Whiteners whiteners_of(const Problem& problem, const linear::ObservationGraph& graph) {
  if (problem.sigma_px.empty() && problem.covariance_px2.empty()) return {};
  return {problem.sigma_px, problem.covariance_px2, graph.source, kReadAhead};
}

}  // namespace

double ImageFit::rms() const { return std::sqrt(sum_of_squares / (2.0 * observations)); }

ImageResiduals::ImageResiduals(const Problem& problem,
                               const linear::ObservationGraph& graph,
                               ThreadPool& pool,
                               Exchange& exchange)
    : problem_(problem),
      graph_(graph),
      pool_(pool),
      exchange_(exchange),
      kernels_(residuals::reprojection_kernels(problem.camera_model)),
      cost_kernels_(residuals::cost_kernels(problem.camera_model)),
      whiteners_(whiteners_of(problem, graph)) {
  if (const CameraFunction* function = problem.camera_model.function())
    function_images_.emplace(*function, graph.num_observations());
  copy_pixels();
}

void ImageResiduals::copy_pixels() {
  const long count = graph_.num_observations();
  for (AlignedVector<double>* array : {&u_, &v_}) {
    array->resize(static_cast<std::size_t>(count) + kReadAhead);
    std::fill_n(array->data() + count, kReadAhead, 1.0);
  }
  pool_.parallel_for_parts(count, kObservationsPerTask, [&](long begin, long end) {
    for (long k = begin; k < end; ++k) {
      const double* pixel = problem_.pixels.data() + 2L * graph_.source[k];
      u_[k] = pixel[0];
      v_[k] = pixel[1];
    }
  });
}

const double* ImageResiduals::inverse_sigma(const Chunk& chunk) const {
  const std::vector<double>& given = whiteners_.inverse_sigma;
  return given.empty() ? kOnes.data() : given.data() + chunk.begin;
}

double ImageResiduals::mean_inverse_variance() const {
  const double count = graph_.num_observations();
  double sum = count;
  if (!whiteners_.inverse_sigma.empty()) {
    sum = 0.0;
    for (int k = 0; k < graph_.num_observations(); ++k)
      sum += whiteners_.inverse_sigma[k] * whiteners_.inverse_sigma[k];
  }
  std::array<double, 2> sums{sum, count};
  exchange_.sum(sums);
  return sums[1] > 0.0 ? sums[0] / sums[1] : 1.0;
}

residuals::ObservationBatch ImageResiduals::batch(const State& state, const Chunk& chunk) const {
  return {.camera = state.cameras.data() + problem_.camera_offset(chunk.camera),
          .intrinsics = state.intrinsics.data() + problem_.intrinsics_offset(chunk.camera),
          .points = state.points.data(),
          .point = graph_.point.data() + chunk.begin,
          .u = u_.data() + chunk.begin,
          .v = v_.data() + chunk.begin,
          .inverse_sigma = inverse_sigma(chunk),
          .count = chunk.end - chunk.begin};
}

residuals::WhitenerShapes ImageResiduals::shapes(const Chunk& chunk) const {
  return whiteners_.shapes_from(chunk.begin);
}

void ImageResiduals::prepare(const State& state, bool with_jacobians) const {
  if (!function_images_) return;
  pool_.parallel_for(static_cast<int>(graph_.chunks.size()), [&](int c) {
    const Chunk& chunk = graph_.chunks[c];
    function_images_->set(chunk.begin, batch(state, chunk));
  });
  function_images_->evaluate(with_jacobians);
}

int ImageResiduals::linearize(const State& state,
                              const Chunk& chunk,
                              const residuals::JacobianOutput& out) const {
  int behind = 0;
  if (function_images_) {
    function_images_->linearize(chunk.begin, batch(state, chunk), out);
  } else {
    behind = kernels_.linearize(batch(state, chunk), out);
  }
  residuals::whiten(shapes(chunk), chunk.end - chunk.begin, out);
  return behind;
}

int ImageResiduals::residuals_of(const State& state,
                                 const Chunk& chunk,
                                 double* ru,
                                 double* rv) const {
  int behind = 0;
  if (function_images_) {
    function_images_->residuals(chunk.begin, batch(state, chunk), ru, rv);
  } else {
    behind = kernels_.residuals(batch(state, chunk), ru, rv);
  }
  residuals::whiten(shapes(chunk), chunk.end - chunk.begin, ru, rv);
  return behind;
}

std::vector<double> ImageResiduals::values(const State& state) const {
  prepare(state, false);
  std::vector<double> values(2 * static_cast<std::size_t>(graph_.num_observations()));
  pool_.parallel_for(static_cast<int>(graph_.chunks.size()), [&](int c) {
    const Chunk& chunk = graph_.chunks[c];
    ChunkResiduals r;
    residuals_of(state, chunk, r.u.data(), r.v.data());
    double* out = values.data() + 2L * chunk.begin;
    for (int k = 0; k < chunk.end - chunk.begin; ++k) {
      out[2 * k] = r.u[k];
      out[2 * k + 1] = r.v[k];
    }
  });
  return values;
}

void ImageResiduals::observation_costs(const State& state,
                                       const Chunk& chunk,
                                       double* costs) const {
  ChunkResiduals r;
  residuals_of(state, chunk, r.u.data(), r.v.data());
  for (int k = 0; k < chunk.end - chunk.begin; ++k) costs[k] = rho(r.squared(k));
}

double ImageResiduals::square_at_place(const State& state, int k, const double* place) const {
  static constexpr std::array<int, 1 + kReadAhead> kFirst{};
  const Chunk one{graph_.camera[k], k, k + 1};
  residuals::ObservationBatch observation = batch(state, one);
  observation.points = place;
  observation.point = kFirst.data();
  std::array<double, 1 + kReadAhead> u, v;
  kernels_.residuals(observation, u.data(), v.data());
  residuals::whiten(shapes(one), 1, u.data(), v.data());
  return u[0] * u[0] + v[0] * v[0];
}

ImageFit ImageResiduals::fit(const State& state, std::vector<double>* costs) const {
  prepare(state, false);
  return sum_over_chunks([&](int c) { return chunk_fit(state, graph_.chunks[c]); }, costs);
}

ChunkFit ImageResiduals::chunk_fit(const State& state, const Chunk& chunk) const {
  if (is_plain()) {
    const auto [squares, behind] = cost_kernels_.cost(batch(state, chunk));
    const CompensatedSum sum = squares.total();
    return {.cost = sum, .sum_of_squares = sum, .behind_camera = behind};
  }
  ChunkResiduals r;
  ChunkFit fit;
  fit.behind_camera = residuals_of(state, chunk, r.u.data(), r.v.data());
  const int count = chunk.end - chunk.begin;
  for (int k = 0; k < count; ++k) fit.sum_of_squares += r.squared(k);
  fit.cost = fit.sum_of_squares;
  if (is_robust()) {
    fit.cost = {};
    for (int k = 0; k < count; ++k) fit.cost += loss_.rho(r.squared(k));
  }
  return fit;
}

void ImageResiduals::add_squares(int count,
                                 const double* records,
                                 residuals::SumOfSquares& squares) const {
  if (is_plain()) return cost_kernels_.add_squares(count, records, squares);
  for (long k = 0; k < count; ++k)
    add_compensated(squares.sums[0],
                    squares.rests[0],
                    residuals::squared_residual(records + residuals::kRecordSize * k));
}

ImageFit ImageResiduals::total() const {
  std::array<CompensatedSum, 4> sums{};
  for (const ChunkFit& fit : fits_) {
    sums[0] += fit.cost;
    sums[1] += fit.sum_of_squares;
    sums[2] += fit.behind_camera;
  }
  sums[3] = graph_.num_observations();
  exchange_.sum(sums);
  return {.cost = 0.5 * sums[0].value(),
          .sum_of_squares = sums[1].value(),
          .observations = sums[3].value(),
          .behind_camera = sums[2].value()};
}

}  // namespace sfmcpp::ba

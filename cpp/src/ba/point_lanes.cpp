#include "sfmcpp/ba/point_lanes.hpp"

#include "sfmcpp/core/simd.hpp"

namespace sfmcpp::ba {
namespace {

using optim::State;
using residuals::kPlaceLanes;

void weigh(const void* loss, int count, const double* squared, double* rho, double* weight) {
  const Loss& of_images = *static_cast<const Loss*>(loss);
  for (int k = 0; k < count; ++k) {
    rho[k] = of_images.rho(squared[k]);
    weight[k] = of_images.derivative(squared[k]);
  }
}

// Those of a point lie anywhere in memory.
SFMCPP_INLINE void prefetch_observations(const ImageResiduals& images, int p) {
  const linear::ObservationGraph& graph = images.graph();
  for (int k = graph.point_begin[p]; k < graph.point_begin[p + 1]; ++k) {
    const int observation = graph.of_point[k];
    __builtin_prefetch(&graph.camera[observation]);
    __builtin_prefetch(&images.u()[observation]);
    __builtin_prefetch(&images.v()[observation]);
  }
}

}  // namespace

PointLanes::PointLanes(const ImageResiduals& images)
    : images_(images),
      kernels_(residuals::place_kernels(images.problem().camera_model)),
      size_of_place_(images.problem().point_storage()),
      has_shapes_(images.shapes({0, 0, 0}).shear != nullptr) {}

// What lies beyond the rows of a point is of earlier points: it does not count.
void PointLanes::set(std::span<const int> points) {
  points_ = points;
  num_rows_ = 0;
  count_.fill(0.0);
  for (int lane = 0; lane < size(); ++lane) {
    count_[lane] = num_views(lane);
    num_rows_ = std::max(num_rows_, num_views(lane));
  }
  const auto entries = static_cast<std::size_t>(kPlaceLanes) * num_rows_;
  for (std::vector<int>* indices : {&camera_, &intrinsics_row_}) indices->resize(entries);
  for (AlignedVector<double>* numbers : {&u_, &v_, &inverse_sigma_}) numbers->resize(entries);
  for (AlignedVector<double>* numbers : {&shear_, &stretch_})
    numbers->resize(has_shapes_ ? entries : 0);
  for (int p : points_) prefetch_observations(images_, p);
  for (int lane = 0; lane < size(); ++lane) set_lane(lane);
}

void PointLanes::set_lane(int lane) {
  const linear::ObservationGraph& graph = images_.graph();
  const int begin = graph.point_begin[points_[lane]];
  for (int k = 0; k < num_views(lane); ++k)
    set_entry(static_cast<std::size_t>(kPlaceLanes) * k + lane, graph.of_point[begin + k]);
}

void PointLanes::set_entry(std::size_t entry, int observation) {
  const int camera = images_.graph().camera[observation];
  const linear::Chunk one{camera, observation, observation + 1};
  camera_[entry] = camera;
  intrinsics_row_[entry] = images_.problem().intrinsics_index[camera];
  u_[entry] = images_.u()[observation];
  v_[entry] = images_.v()[observation];
  inverse_sigma_[entry] = *images_.inverse_sigma(one);
  if (!has_shapes_) return;
  const residuals::WhitenerShapes shape = images_.shapes(one);
  shear_[entry] = *shape.shear;
  stretch_[entry] = *shape.stretch;
}

const double* PointLanes::place_in(const State& state, int lane) const {
  return state.points.data() + images_.problem().point_offset(points_[lane]);
}

double* PointLanes::place_in(State& state, int lane) const {
  return state.points.data() + images_.problem().point_offset(points_[lane]);
}

LanePlaces PointLanes::places_in(const State& state) const {
  LanePlaces places;
  for (int lane = 0; lane < size(); ++lane) places.set(lane, size_of_place_, place_in(state, lane));
  return places;
}

residuals::PlaceRows PointLanes::rows(const State& state) const {
  return {.cameras = state.cameras.data(),
          .intrinsics = state.intrinsics.data(),
          .num_rows = num_rows_,
          .camera = camera_.data(),
          .intrinsics_row = intrinsics_row_.data(),
          .u = u_.data(),
          .v = v_.data(),
          .inverse_sigma = inverse_sigma_.data(),
          .shear = has_shapes_ ? shear_.data() : nullptr,
          .stretch = has_shapes_ ? stretch_.data() : nullptr,
          .count = count_.data(),
          .weigh = images_.is_robust() ? &weigh : nullptr,
          .loss = &images_.loss()};
}

void PointLanes::cost(const State& state, const LanePlaces& places, Costs& costs) const {
  kernels_.cost(rows(state), places.numbers[0], costs.data());
}

void PointLanes::fit(const State& state,
                     const LanePlaces& places,
                     residuals::PlaceFits& fits) const {
  kernels_.fit(rows(state), places.numbers[0], fits);
}

void PointLanesOfThreads::sort(std::span<int> points) const {
  const linear::ObservationGraph& graph = images_.graph();
  std::ranges::sort(points, {}, [&](int p) { return graph.observations_of_point(p); });
}

}  // namespace sfmcpp::ba

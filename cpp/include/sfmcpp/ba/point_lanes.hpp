// Points side by side, with what sees them, so that places are tried for eight at a time: each by
// itself, whichever the others are.
#pragma once

#include <algorithm>
#include <array>
#include <span>
#include <vector>

#include "sfmcpp/ba/image_residuals.hpp"
#include "sfmcpp/residuals/reprojection.hpp"

namespace sfmcpp::ba {

// A place for each of them, as the kernels take them.
struct LanePlaces {
  alignas(64) double numbers[kMaxPointStorage][residuals::kPlaceLanes] = {};

  void set(int lane, int size, const double* place) {
    for (int k = 0; k < size; ++k) numbers[k][lane] = place[k];
  }
  void get(int lane, int size, double* place) const {
    for (int k = 0; k < size; ++k) place[k] = numbers[k][lane];
  }
  void copy_lane(int lane, const LanePlaces& from) {
    for (int k = 0; k < kMaxPointStorage; ++k) numbers[k][lane] = from.numbers[k][lane];
  }
};

class PointLanes {
 public:
  using Costs = std::array<double, residuals::kPlaceLanes>;

  // The images must outlive this object.
  explicit PointLanes(const ImageResiduals& images);

  // kPlaceLanes points at most.
  void set(std::span<const int> points);
  std::span<const int> points() const { return points_; }
  int size() const { return static_cast<int>(points_.size()); }
  int num_views(int lane) const {
    return images_.graph().observations_of_point(points_[static_cast<std::size_t>(lane)]);
  }
  const ImageResiduals& images() const { return images_; }

  // Where a state has the points.
  const double* place_in(const optim::State& state, int lane) const;
  double* place_in(optim::State& state, int lane) const;
  LanePlaces places_in(const optim::State& state) const;

  // Σ ρ(‖r‖²) of each point at a place, as the cameras of a state see it, and with it the normal
  // equations. Unspecified in lanes without a point.
  void cost(const optim::State& state, const LanePlaces& places, Costs& costs) const;
  void fit(const optim::State& state, const LanePlaces& places, residuals::PlaceFits& fits) const;
  // Steps of the places with these λ, and what each promises (residuals::PlaceKernels).
  struct Steps {
    alignas(64) double deltas[kPointTangent][residuals::kPlaceLanes];
    alignas(64) Costs promises;
  };
  void step(const residuals::PlaceFits& fits, const Costs& lambda, Steps& steps) const {
    kernels_.step(fits, lambda.data(), steps.deltas, steps.promises.data());
  }

 private:
  residuals::PlaceRows rows(const optim::State& state) const;
  void set_lane(int lane);
  void set_entry(std::size_t entry, int observation);

  const ImageResiduals& images_;
  residuals::PlaceKernels kernels_;
  int size_of_place_;
  bool has_shapes_;
  std::span<const int> points_;
  int num_rows_ = 0;
  alignas(64) std::array<double, residuals::kPlaceLanes> count_{};
  std::vector<int> camera_, intrinsics_row_;
  AlignedVector<double> u_, v_, inverse_sigma_, shear_, stretch_;
};

// Those of each thread.
class PointLanesOfThreads {
 public:
  explicit PointLanesOfThreads(const ImageResiduals& images) : images_(images) {}

  // Calls f(lanes) for all of the points, in parallel, those together that are seen about as often:
  // a lane waits for the fullest. Changes the order of `points`.
  template <class F>
  void for_each(std::vector<int>& points, const F& f) {
    while (static_cast<int>(lanes_.size()) < images_.pool().num_threads())
      lanes_.emplace_back(images_);
    const auto size = static_cast<long>(points.size()), part = points_per_task(size);
    images_.pool().parallel_for_worker(
        ThreadPool::num_parts(size, part), [&](int task, int worker) {
          const long begin = task * part, end = std::min(begin + part, size);
          sort(std::span(points).subspan(begin, end - begin));
          for (long k = begin; k < end; k += residuals::kPlaceLanes) {
            lanes_[worker].set(
                std::span(points).subspan(k, std::min(long{residuals::kPlaceLanes}, end - k)));
            f(lanes_[worker]);
          }
        });
  }

 private:
  // Enough for lanes that are full alike; fewer where there are few, so that threads end together.
  static long points_per_task(long points) {
    constexpr long kTasks = 16, kMostLanes = 8, kPoints = residuals::kPlaceLanes;
    return kPoints * std::clamp(points / (kTasks * kPoints), 1L, kMostLanes);
  }
  void sort(std::span<int> points) const;

  const ImageResiduals& images_;
  std::vector<PointLanes> lanes_;
};

}  // namespace sfmcpp::ba

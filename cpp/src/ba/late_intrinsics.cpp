#include "sfmcpp/ba/late_intrinsics.hpp"

#include <cmath>

#include "sfmcpp/cameras/camera_model.hpp"
#include "sfmcpp/math/statistics.hpp"

namespace sfmcpp::ba {
namespace {

// |ln f/f₀|. Of 63 synthetic starts (bench/peers/hard_starts.py), those 1° off change focal lengths
// by 0.5 %, or by the 5 % they are wrong by; those 4° off, which need this, by 9 % or more. Whether
// 2, 5 or 10 % made no difference there, since the cost of both steps decides then.
constexpr double kFar = 0.02;

// Of a lens that has no focal length any more.
constexpr double kBeyond = 1e3;

double relative_change(double from, double to) {
  const double ratio = to / from;
  return ratio > 0.0 ? std::abs(std::log(ratio)) : kBeyond;
}

}  // namespace

// Every camera model has its focal length first.
LateIntrinsics::LateIntrinsics(const Problem& problem,
                               const linear::ParameterMap& map,
                               std::span<const int> free_intrinsics) {
  if (free_intrinsics.empty() || free_intrinsics[0] != 0) return;
  if (problem.camera_model.function() != nullptr) return;
  std::vector<char> counted(static_cast<std::size_t>(map.num_columns));
  const int begin = camera_tangent(problem.camera_model);
  for (int i = 0; i < problem.num_cameras(); ++i) {
    const int* columns = map.columns_of(i) + begin;
    if (columns[0] == linear::kNoColumn || counted[columns[0]] != 0) continue;
    counted[columns[0]] = 1;
    focal_lengths_.push_back(problem.intrinsics_offset(i));
  }
}

bool LateIntrinsics::have_moved_far(const optim::State& start,
                                    const optim::State& candidate) const {
  if (focal_lengths_.empty()) return false;
  std::vector<double> changes;
  changes.reserve(focal_lengths_.size());
  for (const std::size_t f : focal_lengths_)
    changes.push_back(relative_change(start.intrinsics[f], candidate.intrinsics[f]));
  return median(std::move(changes)) > kFar;
}

}  // namespace sfmcpp::ba

#include "sfmcpp/ba/point_rows.hpp"

#include <algorithm>
#include <map>
#include <tuple>
#include <utility>

#include "sfmcpp/core/error.hpp"

namespace sfmcpp::ba {
namespace {

using residuals::ConstraintGroup;
using residuals::kNoCamera;

}  // namespace

PointRows::PointRows(const Problem& problem,
                     const linear::ObservationGraph& images,
                     Exchange& exchange)
    : problem_(problem), images_(images) {
  find_members();
  if (empty()) return;
  if (exchange.num_ranks() > 1) {
    throw InvalidArgument("constraints['" + members_[0].group->name +
                          "']: residuals on points, must be on cameras on several ranks");
  }
  make_graph();
}

void PointRows::find_members() {
  if (problem_.constraints == nullptr) return;
  std::size_t pairs = 0;
  for (const ConstraintGroup& group : problem_.constraints->groups()) {
    if (!residuals::is_on_points(group)) continue;
    for (std::size_t k = 0; k < group.members.size(); ++k) {
      if (!residuals::is_active(group, group.members[k])) continue;
      members_.push_back({&group, k, pairs});
      pairs += members_.back().pairs();
    }
  }
}

void PointRows::make_graph() {
  is_on_.assign(static_cast<std::size_t>(problem_.num_points()), 0);
  std::map<std::pair<int, int>, int> rows_of;  // of camera and point, so far
  std::map<std::pair<int, int>, int> twin_of;  // of camera and number
  std::vector<int> camera(problem_.camera_index.begin(), problem_.camera_index.end());
  std::vector<int> point(problem_.point_index.begin(), problem_.point_index.end());
  for (const Member& member : members_) {
    is_on_[member.point()] = 1;
    for (int pair = 0; pair < member.pairs(); ++pair) {
      const int number = rows_of[{member.camera(), member.point()}]++;
      const auto [twin, is_new] = twin_of.try_emplace({member.camera(), number}, twins_.size());
      if (is_new) twins_.push_back(member.camera());
      camera.push_back(problem_.num_cameras() + twin->second);
      point.push_back(member.point());
    }
  }
  const int cameras = problem_.num_cameras() + static_cast<int>(twins_.size());
  graph_ = linear::make_observation_graph(cameras, problem_.num_points(), camera, point);
  const int before = images_.num_observations();
  place_.resize(camera.size() - before);
  for (int k = before; k < graph_.num_observations(); ++k)
    place_[graph_.source[k] - before] = k - before;
}

void PointRows::add_to(linear::ParameterMap& map) const {
  if (empty()) return;
  for (int camera : twins_) {
    for (int k = 0; k < map.camera_size; ++k)
      map.column.push_back(camera == kNoCamera ? linear::kNoColumn : map.columns_of(camera)[k]);
    map.has_shared_columns |= camera != kNoCamera;
  }
  for (int p = 0; p < problem_.num_points(); ++p) {
    if (is_on_[p]) map.free_point[p] = !problem_.is_fixed_point(p);
  }
}

// A pair may have one row.
void PointRows::start(int camera_size) {
  records_.assign(place_.size(), linear::PointRecord{});
  jacobian_.assign(2 * static_cast<std::size_t>(camera_size) * place_.size(), 0.0);
}

void PointRows::set(const ConstraintGroup& group,
                    std::size_t position,
                    const residuals::ConstraintResidual& e) {
  const auto member =
      std::ranges::lower_bound(members_, std::tuple(&group, position), {}, [](const Member& one) {
        return std::tuple(one.group, one.position);
      });
  const std::size_t width = e.by_camera.size() / e.rows;
  for (int row = 0; row < e.rows; ++row) {
    const std::size_t place = place_[member->first + row / 2];
    const std::size_t size = jacobian_.size() / (2 * records_.size());
    std::copy_n(
        e.by_camera.begin() + width * row, width, jacobian_.begin() + size * (2 * place + row % 2));
    auto& [by_point, residual] = records_[place].row[row % 2];
    std::copy_n(e.by_point.begin() + kPointTangent * row, kPointTangent, by_point);
    residual = e.residual[row];
  }
}

void PointRows::fill(linear::NormalEquations& normal) const {
  if (empty()) return;
  const int before = images_.num_observations();
  const std::size_t size = 2 * static_cast<std::size_t>(normal.map().camera_size);
  for (std::size_t c = images_.chunks.size(); c < graph_.chunks.size(); ++c) {
    normal.fill(static_cast<int>(c),
                [&](const linear::Chunk& part, double* jacobian, linear::PointRecord* records) {
                  const int count = part.end - part.begin, first = part.begin - before;
                  std::copy_n(jacobian_.begin() + size * first, size * count, jacobian);
                  std::copy_n(records_.begin() + first, count, records);
                });
  }
}

}  // namespace sfmcpp::ba

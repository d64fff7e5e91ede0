#include "schur_preconditioner.hpp"

#include <algorithm>
#include <iterator>
#include <numeric>
#include <utility>

namespace sfmcpp::linear {
namespace {

// With fewer cameras an iteration costs nothing beside the forming of S.
constexpr int kManyCameras = 500;
constexpr int kCamerasOfCluster = 20;

PreconditionerKind chosen(PreconditionerKind kind, int cameras) {
  if (kind != PreconditionerKind::kAuto) return kind;
  return cameras < kManyCameras ? PreconditionerKind::kSchurJacobi : PreconditionerKind::kClusters;
}

Aggregates each_alone(int cameras) {
  Aggregates result;
  result.members.resize(cameras);
  std::iota(result.members.begin(), result.members.end(), 0);
  result.of_camera = result.begin = result.members;
  result.begin.push_back(cameras);
  return result;
}

}  // namespace

CameraGroups group_cameras(const NormalEquations& normal,
                           const CameraPattern* pattern,
                           PreconditionerKind kind) {
  const int cameras = normal.graph().num_cameras;
  kind = pattern == nullptr ? PreconditionerKind::kSchurJacobi : chosen(kind, cameras);
  if (kind == PreconditionerKind::kSchurJacobi)
    return {.kind = kind, .clusters = each_alone(cameras)};
  CameraNeighbours neighbours =
      neighbours_of(normal.graph(), *pattern, normal.pool(), normal.exchange());
  Aggregates clusters = aggregate_cameras(neighbours, kCamerasOfCluster);
  return {kind, std::move(neighbours), std::move(clusters)};
}

SchurPreconditioner::SchurPreconditioner(const NormalEquations& normal,
                                         const BlockSparseSchur* blocks,
                                         const CameraShares& shares,
                                         const CameraGroups& groups)
    : map_(normal.map()), diagonal_(normal) {
  const std::vector<int> owners = shares.owners_of_columns(map_);
  for (int b = 0; b < map_.num_blocks(); ++b) {
    if (owners[map_.block_begin[b]] == normal.exchange().rank()) own_.push_back(b);
  }
  left_ = own_;
  if (groups.kind == PreconditionerKind::kSchurJacobi) return;
  clusters_ = std::make_unique<ClusterBlocks>(normal, *blocks, shares, groups.clusters);
  if (groups.kind == PreconditionerKind::kTwoLevels)
    coarse_ = std::make_unique<CoarseSpace>(normal, *blocks, groups.neighbours);
}

void SchurPreconditioner::factor(const std::vector<double>& damping) {
  if (clusters_) {
    clusters_->factor(damping);
    find_left();
  }
  diagonal_.factor(damping, left_);
  if (coarse_) coarse_->factor(damping);
}

void SchurPreconditioner::find_left() {
  left_.clear();
  std::ranges::copy_if(own_, std::back_inserter(left_), [this](int b) {
    bool is_covered = true;
    for (int column = map_.block_begin[b]; column < map_.block_begin[b + 1]; ++column)
      is_covered = is_covered && clusters_->covers(column);
    return !is_covered;
  });
}

void SchurPreconditioner::solve(const std::vector<double>& in, std::vector<double>& out) {
  diagonal_.solve(in, out, left_);
  if (clusters_) clusters_->solve(in, out);
  if (coarse_) coarse_->add_correction(in, out);
}

}  // namespace sfmcpp::linear

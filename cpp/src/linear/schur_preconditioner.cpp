#include "schur_preconditioner.hpp"

namespace sfmcpp::linear {
namespace {

// With fewer cameras an iteration costs nothing beside the forming of S.
constexpr int kManyCameras = 500;

PreconditionerKind chosen(PreconditionerKind kind, int cameras) {
  if (kind != PreconditionerKind::kAuto) return kind;
  return cameras < kManyCameras ? PreconditionerKind::kSchurJacobi : PreconditionerKind::kClusters;
}

}  // namespace

SchurPreconditioner::SchurPreconditioner(const NormalEquations& normal,
                                         const BlockSparseSchur* blocks,
                                         const CameraPattern* pattern,
                                         PreconditionerKind kind)
    : diagonal_(normal) {
  kind = chosen(kind, normal.graph().num_cameras);
  if (blocks == nullptr || kind == PreconditionerKind::kSchurJacobi) return;
  const CameraNeighbours neighbours =
      neighbours_of(normal.graph(), *pattern, normal.pool(), normal.exchange());
  clusters_ = std::make_unique<ClusterBlocks>(normal, *blocks, neighbours);
  if (kind == PreconditionerKind::kTwoLevels)
    coarse_ = std::make_unique<CoarseSpace>(normal, *blocks, neighbours);
}

void SchurPreconditioner::factor(const std::vector<double>& damping) {
  diagonal_.factor(damping);
  if (clusters_) clusters_->factor(damping);
  if (coarse_) coarse_->factor(damping);
}

void SchurPreconditioner::solve(const std::vector<double>& in, std::vector<double>& out) {
  diagonal_.solve(in, out);
  if (clusters_) clusters_->solve(in, out);
  if (coarse_) coarse_->add_correction(in, out);
}

}  // namespace sfmcpp::linear

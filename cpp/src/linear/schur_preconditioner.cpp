#include "schur_preconditioner.hpp"

#include <algorithm>
#include <iterator>
#include <numeric>
#include <utility>

#include "sfmcpp/linear/block_layout.hpp"

namespace sfmcpp::linear {

ClusterBlocks::ClusterBlocks(const NormalEquations& normal,
                             const BlockSparseSchur& schur,
                             const CameraPartition& partition,
                             Aggregates clusters)
    : normal_(normal),
      schur_(schur),
      aggregates_(std::move(clusters)),
      place_(panel_places(normal.map().camera_size)),
      row_(normal.map().column.size(), -1),
      clusters_(static_cast<std::size_t>(aggregates_.count())) {
  for (int k = 0; k < aggregates_.count(); ++k) {
    if (partition.is_own(aggregates_.members[aggregates_.begin[k]])) own_.push_back(k);
  }
  number_rows();
}

void ClusterBlocks::number_rows() {
  const int size = normal_.map().camera_size;
  for (int i : aggregates_.members) {
    Cluster& cluster = clusters_[aggregates_.of_camera[i]];
    for (int k = 0; k < size; ++k) {
      const int column = normal_.map().columns_of(i)[k];
      if (column == kNoColumn || normal_.is_shared(column)) continue;
      row_[static_cast<std::size_t>(size) * i + k] = static_cast<int>(cluster.columns.size());
      cluster.columns.push_back(column);
    }
  }
}

void ClusterBlocks::factor(const std::vector<double>& diagonal) {
  normal_.pool().parallel_for(static_cast<int>(own_.size()),
                              [&](int k) { factor_cluster(own_[k], diagonal); });
  is_covered_.assign(diagonal.size(), 0);
  for (int k : own_) {
    for (int column : clusters_[k].columns) is_covered_[column] = clusters_[k].usable;
  }
}

// value(r, c) of the block of cameras i and j.
template <class Value>
void ClusterBlocks::add_block(int i, int j, const Value& value, DenseCholesky& lower) const {
  const int size = normal_.map().camera_size;
  for (int r = 0; r < size; ++r) {
    for (int c = 0; c < size; ++c) {
      const int a = row_of(i, r), b = row_of(j, c);
      if (a < 0 || b < 0 || (i == j && a < b)) continue;
      lower.at(std::max(a, b), std::min(a, b)) += value(r, c);
    }
  }
}

void ClusterBlocks::assemble(int k,
                             const std::vector<double>& diagonal,
                             DenseCholesky& lower) const {
  const int size = normal_.map().camera_size;
  for (int m = aggregates_.begin[k]; m < aggregates_.begin[k + 1]; ++m) {
    const int i = aggregates_.members[m];
    const double* diagonal_block = schur_.diagonal_block(i);
    add_block(
        i, i, [&](int r, int c) { return diagonal_block[place_[size * r + c]]; }, lower);
    const float* block = schur_.blocks_of_row(i);
    for (int j : schur_.columns_behind(i)) {
      const auto value = [&](int r, int c) {
        return block[place_[size * c + r]] * schur_.powers(i)[r] * schur_.powers(j)[c];
      };
      if (aggregates_.of_camera[j] == k) add_block(i, j, value, lower);
      block += size * size;
    }
    normal_.camera_terms().for_each_block(i, [&](int j, const double* of_terms) {
      const auto value = [&](int r, int c) { return of_terms[place_[size * r + c]]; };
      if (aggregates_.of_camera[j] == k) add_block(i, j, value, lower);
    });
  }
  const std::vector<int>& columns = clusters_[k].columns;
  for (std::size_t r = 0; r < columns.size(); ++r)
    lower.at(static_cast<int>(r), static_cast<int>(r)) += diagonal[columns[r]];
}

void ClusterBlocks::factor_cluster(int k, const std::vector<double>& diagonal) {
  Cluster& cluster = clusters_[k];
  const auto n = static_cast<int>(cluster.columns.size());
  ThreadPool alone(1);  // clusters are the tasks
  DenseCholesky cholesky(n);
  cholesky.set_zero(alone);
  assemble(k, diagonal, cholesky);
  cluster.usable = cholesky.factorize(alone);
  cluster.factor.set(cholesky);
}

void ClusterBlocks::solve(const std::vector<double>& in, std::vector<double>& out) const {
  normal_.pool().parallel_for(static_cast<int>(own_.size()),
                              [&](int k) { solve_cluster(clusters_[own_[k]], in, out); });
}

void ClusterBlocks::solve_cluster(const Cluster& cluster,
                                  const std::vector<double>& in,
                                  std::vector<double>& out) {
  if (!cluster.usable) return;
  AlignedVector<double> x(cluster.factor.padded_size());
  for (std::size_t r = 0; r < cluster.columns.size(); ++r) x[r] = in[cluster.columns[r]];
  std::fill(x.begin() + static_cast<long>(cluster.columns.size()), x.end(), 0.0);
  cluster.factor.solve(x.data());
  for (std::size_t r = 0; r < cluster.columns.size(); ++r) out[cluster.columns[r]] = x[r];
}

namespace {

// With fewer cameras an iteration costs nothing beside the forming of S.
constexpr int kManyCameras = 500;

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
  using Use = CoarseSpaceUse;
  const int cameras = normal.graph().num_cameras;
  const bool is_auto = kind == PreconditionerKind::kAuto;
  if (pattern == nullptr || kind == PreconditionerKind::kSchurJacobi)
    return {.clusters = each_alone(cameras)};
  if (is_auto && cameras < kManyCameras)
    return {.clusters = each_alone(cameras), .coarse_space = Use::kLater};
  CameraNeighbours neighbours =
      neighbours_of(normal.graph(), *pattern, normal.pool(), normal.exchange());
  return {.clusters = aggregate_cameras(neighbours, kCamerasOfCluster),
          .are_clusters = true,
          .coarse_space = is_auto                                  ? Use::kLater
                          : kind == PreconditionerKind::kTwoLevels ? Use::kAtOnce
                                                                   : Use::kNever,
          .neighbours = std::move(neighbours)};
}

SchurPreconditioner::SchurPreconditioner(const NormalEquations& normal,
                                         const BlockSparseSchur* blocks,
                                         const CameraPartition& partition,
                                         CameraGroups groups,
                                         std::shared_ptr<const ReducedStructure> structure)
    : map_(normal.map()), diagonal_(normal) {
  const std::vector<int> owners = partition.owners_of_columns(map_);
  for (int b = 0; b < map_.num_blocks(); ++b) {
    if (owners[map_.block_begin[b]] == normal.exchange().rank()) own_.push_back(b);
  }
  left_ = own_;
  if (groups.are_clusters)
    clusters_ = std::make_unique<ClusterBlocks>(normal, *blocks, partition, groups.clusters);
  if (groups.coarse_space != CoarseSpaceUse::kNever)
    coarse_ = std::make_unique<CoarseSpace>(normal,
                                            *blocks,
                                            partition,
                                            std::move(groups.neighbours),
                                            groups.are_clusters ? nullptr : std::move(structure));
  if (groups.coarse_space == CoarseSpaceUse::kAtOnce) take_coarse_space();
}

void SchurPreconditioner::factor(const std::vector<double>& damping) {
  if (clusters_) {
    clusters_->factor(damping);
    find_left();
  }
  diagonal_.factor(damping, left_);
  if (uses_coarse_) coarse_->factor(damping);
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
  if (uses_coarse_) coarse_->add_correction(in, out);
}

}  // namespace sfmcpp::linear

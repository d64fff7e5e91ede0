#include "cluster_blocks.hpp"

#include <algorithm>

#include <Eigen/Core>

#include "sfmcpp/linear/panel_layout.hpp"

namespace sfmcpp::linear {
namespace {

constexpr int kCameras = 20;  // in a cluster

}  // namespace

ClusterBlocks::ClusterBlocks(const NormalEquations& normal,
                             const BlockSparseSchur& schur,
                             const CameraNeighbours& neighbours)
    : normal_(normal),
      aggregates_(aggregate_cameras(neighbours, kCameras)),
      shares_(normal, schur, aggregates_),
      row_(normal.map().column.size(), -1),
      clusters_(static_cast<std::size_t>(aggregates_.count())) {
  const int size = normal.map().camera_size;
  for (int r = 0; r < size; ++r) {
    for (int c = 0; c < size; ++c) place_.push_back(panel_index(size, r, c));
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
  const std::vector<double> received = shares_.receive();
  normal_.pool().parallel_for(shares_.num_own(),
                              [&](int k) { factor_cluster(shares_.own(k), diagonal, received); });
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
                             const std::vector<double>& received,
                             DenseCholesky& lower) const {
  const int size = normal_.map().camera_size;
  const auto add = [&](int i, int j, const auto* block) {
    const auto value = [&](int r, int c) {
      return block[place_[i == j ? size * r + c : size * c + r]];
    };
    add_block(i, j, value, lower);
  };
  shares_.for_each_block(k, add);
  shares_.for_each_received(k, received, add);
  for (int m = aggregates_.begin[k]; m < aggregates_.begin[k + 1]; ++m) {
    const int i = aggregates_.members[m];
    normal_.camera_terms().for_each_block(i, [&](int j, const double* block) {
      const auto value = [&](int r, int c) { return block[place_[size * r + c]]; };
      if (aggregates_.of_camera[j] == k) add_block(i, j, value, lower);
    });
  }
  const std::vector<int>& columns = clusters_[k].columns;
  for (std::size_t r = 0; r < columns.size(); ++r)
    lower.at(static_cast<int>(r), static_cast<int>(r)) += diagonal[columns[r]];
}

void ClusterBlocks::factor_cluster(int k,
                                   const std::vector<double>& diagonal,
                                   const std::vector<double>& received) {
  Cluster& cluster = clusters_[k];
  const auto n = static_cast<int>(cluster.columns.size());
  ThreadPool alone(1);  // clusters are the tasks
  DenseCholesky cholesky(n);
  cholesky.set_zero(alone);
  assemble(k, diagonal, received, cholesky);
  cluster.usable = cholesky.factorize(alone);
  cluster.lower.resize(static_cast<std::size_t>(n) * static_cast<std::size_t>(n));
  for (int c = 0; c < n; ++c) {
    for (int r = c; r < n; ++r)
      cluster.lower[static_cast<std::size_t>(n) * c + r] = static_cast<float>(cholesky.at(r, c));
  }
}

void ClusterBlocks::solve(const std::vector<double>& in, std::vector<double>& out) const {
  normal_.pool().parallel_for(shares_.num_own(),
                              [&](int k) { solve_cluster(clusters_[shares_.own(k)], in, out); });
  if (normal_.exchange().num_ranks() > 1) tell_others(out);
}

void ClusterBlocks::solve_cluster(const Cluster& cluster,
                                  const std::vector<double>& in,
                                  std::vector<double>& out) {
  if (!cluster.usable) return;
  const auto n = static_cast<Eigen::Index>(cluster.columns.size());
  const Eigen::Map<const Eigen::MatrixXf> lower(cluster.lower.data(), n, n);
  Eigen::VectorXf x(n);
  for (Eigen::Index r = 0; r < n; ++r) x[r] = static_cast<float>(in[cluster.columns[r]]);
  lower.triangularView<Eigen::Lower>().solveInPlace(x);
  lower.transpose().triangularView<Eigen::Upper>().solveInPlace(x);
  for (Eigen::Index r = 0; r < n; ++r) out[cluster.columns[r]] = x[r];
}

// Each rank gets what the others have solved.
void ClusterBlocks::tell_others(std::vector<double>& out) const {
  std::vector<double> own;
  for (int k = 0; k < shares_.num_own(); ++k) {
    for (int column : clusters_[shares_.own(k)].columns) own.push_back(out[column]);
  }
  const std::vector<double> all = normal_.exchange().gather(own);
  auto solved = all.begin();
  for (int k : shares_.order()) {
    for (int column : clusters_[k].columns) out[column] = *solved++;
  }
}

}  // namespace sfmcpp::linear

#include "sfmcpp/linear/block_diagonal.hpp"

#include <algorithm>
#include <numeric>

#include <Eigen/Cholesky>

#include "sfmcpp/linear/block_layout.hpp"

namespace sfmcpp::linear {

CameraBlockDiagonal::CameraBlockDiagonal(const NormalEquations& normal)
    : normal_(normal), map_(normal.map()), all_blocks_(map_.num_blocks()) {
  std::iota(all_blocks_.begin(), all_blocks_.end(), 0);
  offset_.push_back(0);
  for (int b = 0; b < map_.num_blocks(); ++b) {
    offset_.push_back(offset_.back() + static_cast<long>(size(b)) * size(b));
  }
  blocks_.resize(offset_.back());
  const auto camera_size = static_cast<std::size_t>(map_.camera_size);
  const auto cameras = static_cast<std::size_t>(normal.graph().num_cameras);
  camera_rhs_.assign(2 * cameras * camera_size, 0.0);
  camera_blocks_.resize(cameras * camera_size * camera_size);
}

void CameraBlockDiagonal::form(const PointFactor* factors) {
  const ObservationGraph& graph = normal_.graph();
  const bool on_grid = normal_.is_compensated();
  if (on_grid) grid_.set(normal_);
  normal_.pool().parallel_for(graph.num_cameras, [&](int i) {
    normal_.kernels().schur_diagonal({.begin = graph.camera_begin[i],
                                      .end = graph.camera_begin[i + 1],
                                      .point = graph.point.data(),
                                      .jacobian = normal_.jacobian(),
                                      .factors = factors,
                                      .gradient = normal_.unrounded_gradient(i),
                                      .diagonal = camera_block(i),
                                      .rhs = camera_rhs(i),
                                      .grid = on_grid ? grid_.of_camera(i) : nullptr,
                                      .compensated_gradient = on_grid});
  });
}

void CameraBlockDiagonal::gather(std::vector<double>& rhs, Exchange& ranks) {
  if (ranks.num_ranks() == 1 && !map_.has_shared_columns) {
    rhs.assign(map_.num_columns, 0.0);
    std::ranges::fill(blocks_, 0.0);
    sum_cameras(true, rhs, blocks_);
  } else {
    std::vector<CompensatedSum> sums(map_.num_columns), entries(blocks_.size());
    sum_cameras(ranks.is_root(), sums, entries);
    ranks.sum(sums);
    ranks.sum(entries);
    rhs.resize(sums.size());
    round_sums(sums, rhs);
    round_sums(entries, blocks_);
  }
  normal_.camera_terms().add_rhs(map_, rhs);
}

namespace {

void add(double sum, double rest, double& to) { to += sum + rest; }
void add(double sum, double rest, CompensatedSum& to) { to += CompensatedSum(sum, rest); }

}  // namespace

template <class T>
void CameraBlockDiagonal::sum_cameras(bool is_root,
                                      std::vector<T>& rhs,
                                      std::vector<T>& entries) const {
  const long size = map_.camera_size;
  normal_.for_each_camera_in_order([&](int i, Columns columns) {
    const double* sum = camera_rhs_.data() + 2 * size * i;
    normal_.for_each_column(
        i, columns, [&](int k, int column) { add(sum[k], sum[size + k], rhs[column]); });
    fold_block(i, camera_blocks_.data() + size * size * i, columns, entries);
    normal_.camera_terms().for_each_block(i, [&](int j, const double* block) {
      if (j == i && is_root) fold_block(i, block, columns, entries);
    });
  });
}

template <class T>
void CameraBlockDiagonal::fold_block(int camera,
                                     const double* panels,
                                     Columns which,
                                     std::vector<T>& entries) const {
  const int camera_size = map_.camera_size;
  const int* columns = map_.columns_of(camera);
  for (int c = 0; c < camera_size; ++c) {
    for (int r = 0; r < camera_size; ++r) {
      if (columns[r] == kNoColumn || columns[c] == kNoColumn) continue;
      if (normal_.is_shared(columns[r]) != (which == Columns::kShared)) continue;
      const int b = map_.block_of[columns[r]];
      if (b != map_.block_of[columns[c]]) continue;
      const int first = map_.block_begin[b];
      entries[offset_[b] + static_cast<long>(columns[c] - first) * size(b) + columns[r] - first] +=
          panels[panel_index(camera_size, r, c)];
    }
  }
}

template <class F>
void CameraBlockDiagonal::for_each(const std::vector<int>& blocks, const F& f) const {
  for_each_camera(normal_.pool(), static_cast<int>(blocks.size()), [&](int k) { f(blocks[k]); });
}

void CameraBlockDiagonal::factor(const std::vector<double>& diagonal,
                                 const std::vector<int>& blocks) {
  for_each(blocks, [&](int b) {
    Eigen::Map<Eigen::MatrixXd> matrix(blocks_.data() + offset_[b], size(b), size(b));
    for (int k = 0; k < size(b); ++k) matrix(k, k) += diagonal[map_.block_begin[b] + k];
    Eigen::LLT<Eigen::MatrixXd> cholesky(matrix);
    if (cholesky.info() == Eigen::Success) {
      matrix = cholesky.matrixL();
    } else {  // fall back to the scaling of each parameter
      matrix =
          matrix.diagonal().cwiseAbs().cwiseMax(1e-300).cwiseSqrt().asDiagonal().toDenseMatrix();
    }
  });
}

void CameraBlockDiagonal::solve(const std::vector<double>& in,
                                std::vector<double>& out,
                                const std::vector<int>& blocks) const {
  out.resize(in.size());
  for_each(blocks, [&](int b) {
    const int first = map_.block_begin[b];
    std::copy_n(in.data() + first, size(b), out.data() + first);
    const Eigen::Map<const Eigen::MatrixXd> lower(blocks_.data() + offset_[b], size(b), size(b));
    Eigen::Map<Eigen::VectorXd> x(out.data() + first, size(b));
    lower.triangularView<Eigen::Lower>().solveInPlace(x);
    lower.transpose().triangularView<Eigen::Upper>().solveInPlace(x);
  });
}

BlockJacobi::BlockJacobi(const NormalEquations& normal)
    : normal_(normal), cameras_(normal), points_(normal) {
  no_factors_.assign(static_cast<std::size_t>(normal.graph().num_points), PointFactor{});
}

void BlockJacobi::factor(const Damping& damping) {
  cameras_.assemble(no_factors_.data(), camera_rhs_);
  cameras_.factor(normal_.camera_damping(damping));
  points_.factor(damping);
}

void BlockJacobi::solve(const Step& g, Step& step) const {
  cameras_.solve(g.camera, step.camera);
  points_.solve(g.point, step.point);
}

void BlockJacobi::sweep(Step& step) {
  cameras_.solve(camera_rhs_, step.camera);
  points_.back_substitute(step);
}

}  // namespace sfmcpp::linear

#include "sfmcpp/linear/implicit_schur.hpp"

#include <algorithm>

#include <Eigen/Cholesky>

#include "sfmcpp/linear/conjugate_gradient.hpp"
#include "sfmcpp/linear/panel_layout.hpp"

namespace sfmcpp::linear {
namespace {

int block_size(const ParameterMap& map, int block) {
  return map.block_begin[block + 1] - map.block_begin[block];
}

}  // namespace

ImplicitSchurSolver::ImplicitSchurSolver(const NormalEquations& normal,
                                         const LinearSolverOptions& options)
    : normal_(normal), options_(options), elimination_(normal) {
  const ParameterMap& map = normal.map();
  block_offset_.push_back(0);
  for (int b = 0; b < map.num_blocks(); ++b) {
    const long size = block_size(map, b);
    block_offset_.push_back(block_offset_.back() + size * size);
  }
  preconditioner_.resize(block_offset_.back());
  const auto size = static_cast<std::size_t>(map.camera_size);
  shifts_.resize(3 * static_cast<std::size_t>(normal.graph().num_points));
  camera_sums_.resize(
      std::max<std::size_t>(normal.graph().chunks.size(), normal.graph().num_cameras) * size);
  camera_blocks_.resize(static_cast<std::size_t>(normal.graph().num_cameras) * size * size);
}

LinearSolveResult ImplicitSchurSolver::solve(const Damping& damping,
                                             Step& step,
                                             const std::function<bool()>& should_stop) {
  elimination_.factor(damping);
  prepare(damping);
  const ConjugateGradientResult result =
      conjugate_gradient([this](const auto& in, auto& out) { apply(in, out); },
                         [this](const auto& in, auto& out) { precondition(in, out); },
                         rhs_,
                         options_.pcg_tolerance,
                         options_.pcg_max_iterations,
                         should_stop,
                         step.camera);
  if (!result.finite) return {.success = false, .iterations = result.iterations};
  elimination_.back_substitute(step);
  return {.success = true, .iterations = result.iterations};
}

void ImplicitSchurSolver::prepare(const Damping& damping) {
  const ParameterMap& map = normal_.map();
  const ObservationGraph& graph = normal_.graph();
  const long size = map.camera_size;
  normal_.pool().parallel_for(graph.num_cameras, [&](int i) {
    const int begin = graph.camera_begin[i];
    normal_.kernels().schur_diagonal(graph.observations_of_camera(i),
                                     normal_.jacobian() + 2 * size * begin,
                                     normal_.records() + static_cast<long>(kPointRecord) * begin,
                                     graph.point.data() + begin,
                                     elimination_.factors(),
                                     camera_blocks_.data() + size * size * i,
                                     camera_sums_.data() + size * i);
  });
  diagonal_.resize(map.num_columns);
  for (int k = 0; k < map.num_columns; ++k) diagonal_[k] = damping(normal_.camera_diagonal()[k]);
  rhs_.assign(map.num_columns, 0.0);
  std::fill(preconditioner_.begin(), preconditioner_.end(), 0.0);
  for (int i = 0; i < graph.num_cameras; ++i) {
    map.fold(camera_sums_.data() + size * i, i, rhs_.data());
    fold_diagonal_block(i, camera_blocks_.data() + size * size * i);
  }
  factor_preconditioner();
}

// Intrinsics shared by a group get the sum over its cameras of their diagonal blocks; the terms
// between two cameras of the group are left out, which keeps the preconditioner positive definite.
void ImplicitSchurSolver::fold_diagonal_block(int i, const double* values) {
  const ParameterMap& map = normal_.map();
  const int size = map.camera_size;
  const int* columns = map.columns_of(i);
  for (int c = 0; c < size; ++c) {
    for (int r = 0; r < size; ++r) {
      if (columns[r] == kNoColumn || columns[c] == kNoColumn) continue;
      const int b = map.block_of[columns[r]];
      if (b != map.block_of[columns[c]]) continue;
      const int first = map.block_begin[b];
      block(b)[(columns[c] - first) * block_size(map, b) + columns[r] - first] +=
          values[panel_index(size, r, c)];
    }
  }
}

void ImplicitSchurSolver::factor_preconditioner() {
  const ParameterMap& map = normal_.map();
  for (int b = 0; b < map.num_blocks(); ++b) {
    const int size = block_size(map, b);
    Eigen::Map<Eigen::MatrixXd> matrix(block(b), size, size);
    for (int k = 0; k < size; ++k) matrix(k, k) += diagonal_[map.block_begin[b] + k];
    Eigen::LLT<Eigen::MatrixXd> cholesky(matrix);
    if (cholesky.info() == Eigen::Success) {
      matrix = cholesky.matrixL();
    } else {  // fall back to the scaling of each parameter
      matrix =
          matrix.diagonal().cwiseAbs().cwiseMax(1e-300).cwiseSqrt().asDiagonal().toDenseMatrix();
    }
  }
}

void ImplicitSchurSolver::set_shifts(const double* sums) {
  for_each_point(normal_.pool(), normal_.graph().num_points, [&](int p) {
    multiply_by_transposed_factor(elimination_.factor(p), sums + 3L * p, shifts_.data() + 3L * p);
  });
}

void ImplicitSchurSolver::apply(const std::vector<double>& x, std::vector<double>& out) {
  const ParameterMap& map = normal_.map();
  const ObservationGraph& graph = normal_.graph();
  const long size = map.camera_size;
  set_shifts(elimination_.point_sums(x));
  normal_.pool().parallel_for(static_cast<int>(graph.chunks.size()), [&](int chunk) {
    const Chunk& c = graph.chunks[chunk];
    double* sum = camera_sums_.data() + size * chunk;
    std::fill_n(sum, size, 0.0);
    normal_.kernels().schur_product(c.end - c.begin,
                                    normal_.jacobian() + 2 * size * c.begin,
                                    normal_.records() + static_cast<long>(kPointRecord) * c.begin,
                                    graph.point.data() + c.begin,
                                    shifts_.data(),
                                    elimination_.expanded(c.camera),
                                    sum);
  });
  for (std::size_t k = 0; k < out.size(); ++k) out[k] = diagonal_[k] * x[k];
  for (std::size_t chunk = 0; chunk < graph.chunks.size(); ++chunk) {
    map.fold(camera_sums_.data() + size * static_cast<long>(chunk),
             graph.chunks[chunk].camera,
             out.data());
  }
}

void ImplicitSchurSolver::precondition(const std::vector<double>& in,
                                       std::vector<double>& out) const {
  const ParameterMap& map = normal_.map();
  out = in;
  for (int b = 0; b < map.num_blocks(); ++b) {
    const int size = block_size(map, b);
    const Eigen::Map<const Eigen::MatrixXd> lower(
        preconditioner_.data() + block_offset_[b], size, size);
    Eigen::Map<Eigen::VectorXd> x(out.data() + map.block_begin[b], size);
    lower.triangularView<Eigen::Lower>().solveInPlace(x);
    lower.transpose().triangularView<Eigen::Upper>().solveInPlace(x);
  }
}

}  // namespace sfmcpp::linear

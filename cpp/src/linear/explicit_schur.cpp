#include "sfmcpp/linear/explicit_schur.hpp"

#include <algorithm>
#include <array>

namespace sfmcpp::linear {

ExplicitSchurSolver::ExplicitSchurSolver(const NormalEquations& normal, LinearSolverKind kind)
    : normal_(normal), pattern_(make_camera_pattern(normal.graph())), factors_(normal) {
  const auto size = static_cast<std::size_t>(normal.map().camera_size);
  coupling_.resize(static_cast<std::size_t>(normal.graph().num_observations()) * 3 * size);
  blocks_.resize(static_cast<std::size_t>(pattern_.num_blocks()) * size * size);
  rhs_.resize(static_cast<std::size_t>(normal.graph().num_cameras) * size);
  steps_.resize(rhs_.size());
  block_of_camera_.assign(normal.pool().num_threads(),
                          std::vector<int>(normal.graph().num_cameras));
  reduced_ = kind == LinearSolverKind::kSparse && normal.map().num_columns > 0
                 ? make_sparse_reduced_solver(pattern_, normal.map())
                 : make_dense_reduced_solver(pattern_, normal.map(), normal.pool());
}

LinearSolveResult ExplicitSchurSolver::solve(const Damping& damping,
                                             Step& step,
                                             const std::function<bool()>&) {
  factors_.factor(damping);
  couple();
  form();
  const std::vector<double>& undamped = normal_.camera_diagonal();
  std::vector<double> diagonal(undamped.size());
  for (std::size_t k = 0; k < diagonal.size(); ++k) diagonal[k] = damping(undamped[k]);
  set_rhs(step.camera);
  if (!reduced_->solve(blocks_.data(), diagonal, step.camera)) return {};
  back_substitute(step);
  return {.success = true, .iterations = 0};
}

void ExplicitSchurSolver::couple() {
  const long size = normal_.map().camera_size;
  const ObservationGraph& graph = normal_.graph();
  normal_.pool().parallel_for(static_cast<int>(graph.chunks.size()), [&](int chunk) {
    const Chunk& c = graph.chunks[chunk];
    normal_.kernels().couple(c.end - c.begin,
                             normal_.records() + static_cast<long>(kPointRecord) * c.begin,
                             graph.point.data() + c.begin,
                             factors_.data(),
                             normal_.jacobian() + 2 * size * c.begin,
                             coupling_.data() + 3 * size * c.begin);
  });
}

void ExplicitSchurSolver::set_rhs(std::vector<double>& rhs) const {
  rhs = normal_.camera_rhs();
  const ParameterMap& map = normal_.map();
  for (int i = 0; i < normal_.graph().num_cameras; ++i) {
    map.fold(rhs_.data() + static_cast<long>(map.camera_size) * i, i, rhs.data());
  }
}

void ExplicitSchurSolver::back_substitute(Step& step) {
  const ParameterMap& map = normal_.map();
  const ObservationGraph& graph = normal_.graph();
  for (int i = 0; i < graph.num_cameras; ++i) {
    map.expand(step.camera.data(), i, steps_.data() + static_cast<long>(map.camera_size) * i);
  }
  step.point.resize(3 * static_cast<std::size_t>(graph.num_points));
  normal_.pool().parallel_for(num_point_tasks(graph.num_points), [&](int task) {
    const int begin = task * kPointsPerTask,
              end = std::min(begin + kPointsPerTask, graph.num_points);
    std::array<double, 3 * kPointsPerTask> sums;
    normal_.kernels().coupled_sums(
        graph.view(), begin, end, coupling_.data(), steps_.data(), sums.data());
    for (int p = begin; p < end; ++p) {
      factors_.back_substitute(p, sums.data() + 3 * (p - begin), step.point.data() + 3L * p);
    }
  });
}

void ExplicitSchurSolver::form() {
  normal_.pool().parallel_for_worker(pattern_.num_rows(),
                                     [this](int i, int worker) { form_row(i, worker); });
}

void ExplicitSchurSolver::form_row(int i, int worker) {
  const ObservationGraph& graph = normal_.graph();
  const long size = normal_.map().camera_size;
  const long first = pattern_.row_begin[i], end = pattern_.row_begin[i + 1];
  int* block_of_camera = block_of_camera_[worker].data();
  for (long block = first; block < end; ++block) {
    block_of_camera[pattern_.column[block]] = static_cast<int>(block - first);
  }
  double* row_blocks = blocks_.data() + first * size * size;
  std::fill(row_blocks + size * size, row_blocks + (end - first) * size * size, 0.0);
  normal_.kernels().schur_row({.graph = graph.view(),
                               .begin = graph.camera_begin[i],
                               .end = graph.camera_begin[i + 1],
                               .jacobian = normal_.jacobian(),
                               .coupling = coupling_.data(),
                               .factors = factors_.data(),
                               .block_of_camera = block_of_camera,
                               .diagonal = row_blocks,
                               .blocks = row_blocks,
                               .rhs = rhs_.data() + size * i});
}

}  // namespace sfmcpp::linear

#include "sfmcpp/linear/explicit_schur.hpp"

#include <algorithm>

namespace sfmcpp::linear {

ExplicitSchurSolver::ExplicitSchurSolver(const NormalEquations& normal, LinearSolverKind kind)
    : normal_(normal),
      pattern_(make_camera_pattern(normal.graph(), normal.camera_terms().pairs())),
      elimination_(normal) {
  const auto size = static_cast<std::size_t>(normal.map().camera_size);
  rows_.resize(normal.map().has_shared_columns ? pattern_.num_rows() : normal.pool().num_threads());
  rhs_.resize(static_cast<std::size_t>(normal.graph().num_cameras) * size);
  block_of_camera_.assign(normal.pool().num_threads(),
                          std::vector<int>(normal.graph().num_cameras));
  reduced_ = kind == LinearSolverKind::kSparse && normal.map().num_columns > 0
                 ? make_sparse_reduced_solver(pattern_, normal.map())
                 : make_dense_reduced_solver(pattern_, normal.map(), normal.pool());
}

LinearSolveResult ExplicitSchurSolver::solve(const Damping& damping,
                                             Step& step,
                                             const std::function<bool()>&) {
  if (!factorize(damping)) return {};
  set_rhs(step.camera);
  if (!solve_reduced(step.camera)) return {};
  elimination_.back_substitute(step);
  return {.success = true, .iterations = 0};
}

bool ExplicitSchurSolver::factorize(const Damping& damping) {
  elimination_.factor(damping);
  reduced_->start(normal_.camera_damping(damping));
  form();
  return reduced_->factorize();
}

bool ExplicitSchurSolver::solve_reduced(std::vector<double>& x) { return reduced_->solve(x); }

void ExplicitSchurSolver::set_rhs(std::vector<double>& rhs) const {
  const ParameterMap& map = normal_.map();
  rhs.assign(map.num_columns, 0.0);
  for (int i = 0; i < normal_.graph().num_cameras; ++i) {
    map.fold(rhs_.data() + static_cast<long>(map.camera_size) * i, i, rhs.data());
  }
  normal_.camera_terms().add_rhs(map, rhs);
}

void ExplicitSchurSolver::form() {
  const bool in_order = normal_.map().has_shared_columns;
  normal_.pool().parallel_for_worker(pattern_.num_rows(), [&](int i, int worker) {
    AlignedVector<double>& row = rows_[in_order ? i : worker];
    form_row(i, worker, row);
    if (!in_order) reduced_->add_row(i, row.data());
  });
  for (int i = 0; in_order && i < pattern_.num_rows(); ++i) reduced_->add_row(i, rows_[i].data());
}

void ExplicitSchurSolver::form_row(int i, int worker, AlignedVector<double>& row) {
  const ObservationGraph& graph = normal_.graph();
  const long size = normal_.map().camera_size;
  const long first = pattern_.row_begin[i], end = pattern_.row_begin[i + 1];
  int* block_of_camera = block_of_camera_[worker].data();
  for (long block = first; block < end; ++block) {
    block_of_camera[pattern_.column[block]] = static_cast<int>(block - first);
  }
  row.assign(static_cast<std::size_t>((end - first) * size * size), 0.0);
  normal_.kernels().schur_row({.graph = graph.view(),
                               .begin = graph.camera_begin[i],
                               .end = graph.camera_begin[i + 1],
                               .jacobian = normal_.jacobian(),
                               .records = normal_.records(),
                               .factors = elimination_.factors(),
                               .block_of_camera = block_of_camera,
                               .diagonal = row.data(),
                               .blocks = row.data(),
                               .rhs = rhs_.data() + size * i});
  add_camera_terms(i, block_of_camera, row.data());
}

void ExplicitSchurSolver::add_camera_terms(int i, const int* block_of_camera, double* row) const {
  const long entries = static_cast<long>(normal_.map().camera_size) * normal_.map().camera_size;
  normal_.camera_terms().for_each_block(i, [&](int j, const double* block) {
    double* sum = row + entries * block_of_camera[j];
    for (long k = 0; k < entries; ++k) sum[k] += block[k];
  });
}

}  // namespace sfmcpp::linear

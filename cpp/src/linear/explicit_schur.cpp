#include "sfmcpp/linear/explicit_schur.hpp"

#include <algorithm>
#include <array>

#include "reduced_solver.hpp"

namespace sfmcpp::linear {

namespace {

// Where cameras share columns.
constexpr int kRowsPerBatch = 64;

std::shared_ptr<const ReducedStructure> make_structure(const NormalEquations& normal, bool sparse) {
  CameraPattern pattern = make_global_camera_pattern(
      normal.graph(), normal.camera_terms().pairs(), normal.pool(), normal.exchange());
  return std::make_shared<ReducedStructure>(
      sparse ? make_sparse_structure(std::move(pattern), normal.map(), normal.pool())
             : ReducedStructure{.pattern = std::move(pattern)});
}

}  // namespace

ExplicitSchurSolver::ExplicitSchurSolver(const NormalEquations& normal,
                                         LinearSolverKind kind,
                                         std::shared_ptr<const ReducedStructure> structure)
    : normal_(normal),
      structure_(structure ? std::move(structure)
                           : make_structure(normal, kind == LinearSolverKind::kSparse)),
      pattern_(structure_->pattern),
      elimination_(normal),
      other_residuals_(normal, elimination_),
      schur_rows_(normal, elimination_, pattern_) {
  const auto size = static_cast<std::size_t>(normal.map().camera_size);
  rows_.resize(normal.map().has_shared_columns
                   ? kRowsPerBatch
                   : normal.pool().num_threads() * schur_rows_.rows_at_once());
  rhs_.resize(static_cast<std::size_t>(normal.graph().num_cameras) * size);
  const bool sparse = kind == LinearSolverKind::kSparse && normal.map().num_columns > 0;
  const auto make = sparse ? make_sparse_reduced_solver : make_dense_reduced_solver;
  reduced_ = make(*structure_, normal.map(), normal.pool());
}

ExplicitSchurSolver::~ExplicitSchurSolver() = default;

LinearSolveResult ExplicitSchurSolver::solve(const Damping& damping,
                                             Step& step,
                                             const std::function<bool()>&) {
  if (!has_factors_of(damping) && !factorize(damping)) return {};
  set_rhs(step.camera);
  if (!solve_reduced(step.camera)) return {};
  elimination_.back_substitute(step);
  return {.success = true, .iterations = 0};
}

bool ExplicitSchurSolver::solve_again(Unknowns unknowns,
                                      std::span<const double> residuals,
                                      Step& step) {
  if (unknowns == Unknowns::kPoints) {
    other_residuals_.solve_points(residuals, step);
    return true;
  }
  other_residuals_.reduce(residuals, step.camera);
  if (!solve_reduced(step.camera)) return false;
  other_residuals_.back_substitute(step);
  return true;
}

// Of all unknowns, while the intrinsics are held: the part of the poses serves as it is.
bool ExplicitSchurSolver::has_factors_of(const Damping& damping) const {
  return normal_.holds_intrinsics() && reduced_->has_poses_first() &&
         factored_ == normal_.damped(damping);
}

bool ExplicitSchurSolver::factorize(const Damping& damping) {
  factored_.reset();
  elimination_.factor(damping);
  normal_.get_camera_damping(damping, damping_);
  if (!normal_.exchange().is_root()) std::ranges::fill(damping_, 0.0);
  reduced_->start(damping_);
  form();
  reduced_->sum_over(normal_.exchange());
  if (!reduced_->factorize()) return false;
  factored_ = normal_.damped(damping);
  return true;
}

bool ExplicitSchurSolver::solve_reduced(std::vector<double>& x) {
  const bool poses_alone = normal_.holds_intrinsics() && reduced_->has_poses_first();
  return poses_alone ? reduced_->solve_poses(x) : reduced_->solve(x);
}
void ExplicitSchurSolver::solve_reduced(Eigen::MatrixXd& x) { reduced_->solve_columns(x); }
Eigen::MatrixXd ExplicitSchurSolver::inverse_product(const Eigen::SparseMatrix<double>& x,
                                                     int worker) {
  return reduced_->inverse_product(x, worker);
}
double ExplicitSchurSolver::log_determinant() const { return reduced_->log_determinant(); }

void ExplicitSchurSolver::set_rhs(std::vector<double>& rhs) const {
  const ParameterMap& map = normal_.map();
  rhs.assign(map.num_columns, 0.0);
  normal_.for_each_camera_in_order([&](int i, Columns columns) {
    normal_.fold(rhs_.data() + static_cast<long>(map.camera_size) * i, i, columns, rhs.data());
  });
  normal_.exchange().sum(rhs);
  normal_.camera_terms().add_rhs(map, rhs);
}

void ExplicitSchurSolver::form() {
  const bool shared = normal_.map().has_shared_columns;
  const int count = pattern_.num_rows(), batch = shared ? kRowsPerBatch : count;
  const int at_once = schur_rows_.rows_at_once();
  for (int begin = 0; begin < count; begin += batch) {
    const int end = std::min(begin + batch, count);
    const int tasks = ThreadPool::num_parts(end - begin, at_once);
    normal_.pool().parallel_for_worker(tasks, [&](int task, int worker) {
      const int first = begin + task * at_once, last = std::min(first + at_once, end);
      const std::span rows(rows_.data() + (shared ? first - begin : worker * at_once), at_once);
      form_rows(first, last, worker, rows);
      for (int i = first; i < last; ++i)
        reduced_->add_row(i, rows[i - first].data(), Columns::kOfOneCamera);
    });
    for (int i = begin; shared && i < end; ++i)
      reduced_->add_row(i, rows_[i - begin].data(), Columns::kShared);
  }
}

void ExplicitSchurSolver::form_rows(int begin,
                                    int end,
                                    int worker,
                                    std::span<AlignedVector<double>> rows) {
  const long size = normal_.map().camera_size, area = size * size;
  std::array<int, SchurRows::kMostRows> cameras;
  std::array<SchurRows::Place, SchurRows::kMostRows> places;
  for (int i = begin; i < end; ++i) {
    AlignedVector<double>& row = rows[i - begin];
    row.resize(pattern_.columns_of_row(i).size() * area);
    cameras[i - begin] = i;
    places[i - begin] = {row.data(), row.data() + area, rhs_.data() + size * i};
  }
  const auto count = static_cast<std::size_t>(end - begin);
  schur_rows_.form({cameras.data(), count}, {places.data(), count}, worker);
  if (!normal_.exchange().is_root()) return;
  for (int k = 0; k < end - begin; ++k)
    add_camera_terms(begin + k, schur_rows_.block_of_camera(worker, k), places[k].blocks);
}

// `blocks` are those behind the diagonal one.
void ExplicitSchurSolver::add_camera_terms(int i,
                                           const int* block_of_camera,
                                           double* blocks) const {
  const long entries = static_cast<long>(normal_.map().camera_size) * normal_.map().camera_size;
  normal_.camera_terms().for_each_block(i, [&](int j, const double* block) {
    double* sum = blocks + entries * block_of_camera[j];
    for (long k = 0; k < entries; ++k) sum[k] += block[k];
  });
}

}  // namespace sfmcpp::linear

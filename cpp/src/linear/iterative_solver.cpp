#include "iterative_solver.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "sfmcpp/linear/vector_algebra.hpp"

namespace sfmcpp::linear {
namespace {

// The smallest tolerance for which a system with entries rounded to single precision is solved.
constexpr double kTrustedTolerance = 1e-4;
// Where the forcing sequence decides: no residual needs to be smaller than this. With S in blocks
// iterations are cheap, and on a city of 3,000 cameras steps solved to 3e-3 saved one of four; from
// the Jacobian each costs about as much as the linearisation.
constexpr double kFloorOfBlocks = 3e-3;
constexpr double kFloorFromJacobian = 1e-2;
// A step of more iterations than this brings in the coarse space for the next: with it, they cost
// half as much again and are five to ten times fewer.
constexpr int kIterationsOfOneLevel = 20;

// What a camera costs in an iteration, in blocks of S: those of its row, and its share of the
// factor of its cluster, which is read twice; or, from the Jacobian, observations.
std::vector<double> work_of_cameras(const NormalEquations& normal,
                                    const ReducedStructure* structure,
                                    const Aggregates& clusters) {
  if (structure == nullptr) return normal.graph().of_camera_on_all_ranks;
  const CameraPattern& pattern = structure->pattern;
  std::vector<double> work(pattern.num_rows());
  for (int i = 0; i < pattern.num_rows(); ++i) {
    const int cluster = clusters.of_camera[i];
    work[i] = static_cast<double>(pattern.columns_of_row(i).size()) +
              (clusters.begin[cluster + 1] - clusters.begin[cluster]);
  }
  return work;
}

}  // namespace

IterativeSolver::IterativeSolver(const NormalEquations& normal,
                                 const LinearSolverOptions& options,
                                 const std::shared_ptr<const ReducedStructure>& structure)
    : IterativeSolver(
          normal,
          options,
          structure,
          group_cameras(
              normal, structure ? &structure->pattern : nullptr, options.preconditioner)) {}

IterativeSolver::IterativeSolver(const NormalEquations& normal,
                                 const LinearSolverOptions& options,
                                 const std::shared_ptr<const ReducedStructure>& structure,
                                 CameraGroups groups)
    : normal_(normal),
      options_(options),
      elimination_(normal),
      other_residuals_(normal, elimination_),
      partition_(
          normal, groups.clusters, work_of_cameras(normal, structure.get(), groups.clusters)),
      implicit_(make_implicit_schur(normal, elimination_)),
      blocks_(structure
                  ? std::make_unique<BlockSparseSchur>(normal, elimination_, partition_, structure)
                  : nullptr),
      product_(normal, blocks_ ? static_cast<SchurOperator&>(*blocks_) : *implicit_, partition_),
      preconditioner_(normal, blocks_.get(), partition_, std::move(groups), structure),
      conjugate_gradients_(normal.pool(), normal.exchange()) {}

LinearSolveResult IterativeSolver::solve(const Damping& damping,
                                         Step& step,
                                         const std::function<bool()>& should_stop) {
  form(damping);
  normal_.get_camera_damping(damping, damping_);
  product_.columns().take(damping_, diagonal_);
  const SchurOperator& schur = product_.schur();
  schur.gather(preconditioner_.diagonal(), whole_rhs_);
  product_.columns().take(whole_rhs_, rhs_);
  preconditioner_.factor(damping_);
  const double tolerance =
      options_.pcg_tolerance.value_or(blocks_ ? kFloorOfBlocks : kFloorFromJacobian);
  ConjugateGradientResult result =
      correct(rhs_,
              schur.is_rounded() ? std::max(tolerance, kTrustedTolerance) : tolerance,
              options_.pcg_max_iterations,
              should_stop,
              solution_);
  if (schur.is_rounded() && tolerance < kTrustedTolerance && !result.stopped)
    refine(tolerance, should_stop, result, solution_);
  learn(result.iterations);
  if (!result.finite) return {.success = false, .iterations = result.iterations};
  product_.columns().gather(solution_, step.camera);
  elimination_.back_substitute(step);
  return {.success = true, .iterations = result.iterations};
}

void IterativeSolver::learn(int iterations) {
  iterations_of_solves_.push_back(iterations);
  if (iterations > kIterationsOfOneLevel) preconditioner_.take_coarse_space();
}

void IterativeSolver::replay(const std::vector<int>& iterations_of_solves) {
  for (int iterations : iterations_of_solves) learn(iterations);
}

// A step with other columns held has the same S but for λD.
void IterativeSolver::form(const Damping& damping) {
  const DampedSystem wanted = normal_.damped(damping);
  if (formed_ == wanted) return;
  formed_.reset();  // whatever stops the work
  elimination_.factor(damping);
  product_.schur().form(preconditioner_.diagonal());
  formed_ = wanted;
}

ConjugateGradientResult IterativeSolver::correct(const Vector& residual,
                                                 double tolerance,
                                                 int max_iterations,
                                                 const std::function<bool()>& should_stop,
                                                 Vector& x) {
  return conjugate_gradients_.solve(
      [this](const auto& in, auto& out) { product_.apply(diagonal_, in, out); },
      [this](const auto& in, auto& out) { precondition(in, out); },
      residual,
      {.tolerance = tolerance,
       .forcing = options_.pcg_tolerance ? 0.0 : options_.pcg_forcing,
       .max_iterations = max_iterations},
      should_stop,
      x);
}

void IterativeSolver::precondition(const Vector& in, Vector& out) {
  if (partition_.are_all_own()) return preconditioner_.solve(in, out);
  in_.resize(normal_.map().num_columns);  // zero but for own columns
  product_.columns().place(in, in_);
  preconditioner_.solve(in_, out_);
  product_.columns().take(out_, out);
}

// The norm of the tolerance: that of the inverse of the preconditioner.
double IterativeSolver::norm(const Vector& residual) {
  Vector z(residual.size());
  precondition(residual, z);
  return std::sqrt(normal_.exchange().sum(dot(normal_.pool(), residual, z)));
}

void IterativeSolver::refine(double tolerance,
                             const std::function<bool()>& should_stop,
                             ConjugateGradientResult& result,
                             Vector& x) {
  if (!unrounded_)
    unrounded_ = std::make_unique<DistributedProduct>(normal_, *implicit_, partition_);
  const double target = tolerance * norm(rhs_);
  Vector residual = residual_of(*unrounded_, x), correction;
  double size = norm(residual);
  while (result.finite && !result.stopped && size > target &&
         result.iterations < options_.pcg_max_iterations) {
    const ConjugateGradientResult next = correct(residual,
                                                 std::max(target / size, kTrustedTolerance),
                                                 options_.pcg_max_iterations - result.iterations,
                                                 should_stop,
                                                 correction);
    result.iterations += next.iterations;
    result.finite = next.finite;
    result.stopped = next.stopped;
    add_scaled(normal_.pool(), 1.0, correction, x);
    residual = residual_of(*unrounded_, x);
    const double before = std::exchange(size, norm(residual));
    if (!(size < 0.5 * before)) break;  // limited by the rounding of the blocks, or stopped
  }
}

Vector IterativeSolver::residual_of(DistributedProduct& product, const Vector& x) const {
  Vector residual(x.size());
  product.apply(diagonal_, x, residual);
  for (std::size_t k = 0; k < residual.size(); ++k) residual[k] = rhs_[k] - residual[k];
  return residual;
}

}  // namespace sfmcpp::linear

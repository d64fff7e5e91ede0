#include "iterative_solver.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "sfmcpp/linear/vector_algebra.hpp"

namespace sfmcpp::linear {
namespace {

// What is asked of a system whose entries are rounded to single precision, at most.
constexpr double kTrustedTolerance = 1e-4;
// Where the forcing sequence decides: no residual needs to be smaller than this. With S in blocks
// iterations are cheap, and on a city of 3,000 cameras steps solved to 3e-3 saved one of four; from
// the Jacobian each costs about as much as the linearisation.
constexpr double kFloorOfBlocks = 3e-3;
constexpr double kFloorFromJacobian = 1e-2;

// S·x is a sum over ranks: each keeps the blocks that its own points give.
std::unique_ptr<BlockSparseSchur> blocks_of_this_rank(
    const NormalEquations& normal,
    PointElimination& elimination,
    std::shared_ptr<const ReducedStructure> structure) {
  if (!structure) return nullptr;
  if (normal.exchange().num_ranks() > 1) {
    structure = std::make_shared<ReducedStructure>(
        ReducedStructure{.pattern = make_camera_pattern(
                             normal.graph(), normal.camera_terms().pairs(), normal.pool())});
  }
  return std::make_unique<BlockSparseSchur>(normal, elimination, std::move(structure));
}

}  // namespace

IterativeSolver::IterativeSolver(const NormalEquations& normal,
                                 const LinearSolverOptions& options,
                                 const std::shared_ptr<const ReducedStructure>& structure)
    : normal_(normal),
      options_(options),
      elimination_(normal),
      other_residuals_(normal, elimination_),
      implicit_(make_implicit_schur(normal, elimination_)),
      blocks_(blocks_of_this_rank(normal, elimination_, structure)),
      preconditioner_(normal,
                      blocks_.get(),
                      structure ? &structure->pattern : nullptr,
                      options.preconditioner) {}

LinearSolveResult IterativeSolver::solve(const Damping& damping,
                                         Step& step,
                                         const std::function<bool()>& should_stop) {
  elimination_.factor(damping);
  diagonal_ = normal_.camera_damping(damping);
  SchurOperator& schur = blocks_ ? *blocks_ : *implicit_;
  schur.assemble(preconditioner_.diagonal(), rhs_);
  preconditioner_.factor(diagonal_);
  const double tolerance =
      options_.pcg_tolerance.value_or(blocks_ ? kFloorOfBlocks : kFloorFromJacobian);
  ConjugateGradientResult result =
      correct(rhs_,
              schur.is_rounded() ? std::max(tolerance, kTrustedTolerance) : tolerance,
              options_.pcg_max_iterations,
              should_stop,
              step.camera);
  if (schur.is_rounded() && tolerance < kTrustedTolerance && !result.stopped)
    refine(tolerance, should_stop, result, step.camera);
  if (!result.finite) return {.success = false, .iterations = result.iterations};
  elimination_.back_substitute(step);
  return {.success = true, .iterations = result.iterations};
}

ConjugateGradientResult IterativeSolver::correct(const Vector& residual,
                                                 double tolerance,
                                                 int max_iterations,
                                                 const std::function<bool()>& should_stop,
                                                 Vector& x) {
  SchurOperator& schur = blocks_ ? *blocks_ : *implicit_;
  return conjugate_gradient(
      normal_.pool(),
      [&](const auto& in, auto& out) { apply(schur, in, out); },
      [this](const auto& in, auto& out) { preconditioner_.solve(in, out); },
      residual,
      {.tolerance = tolerance,
       .forcing = options_.pcg_tolerance ? 0.0 : options_.pcg_forcing,
       .max_iterations = max_iterations},
      should_stop,
      x);
}

// In which the tolerance is meant.
double IterativeSolver::norm(const Vector& residual) {
  Vector z(residual.size());
  preconditioner_.solve(residual, z);
  return std::sqrt(dot(normal_.pool(), residual, z));
}

void IterativeSolver::refine(double tolerance,
                             const std::function<bool()>& should_stop,
                             ConjugateGradientResult& result,
                             Vector& x) {
  const double target = tolerance * norm(rhs_);
  Vector residual = residual_of(*implicit_, x), correction;
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
    residual = residual_of(*implicit_, x);
    const double before = std::exchange(size, norm(residual));
    if (!(size < 0.5 * before)) break;  // rounding of the blocks has the last word, or a user
  }
}

IterativeSolver::Vector IterativeSolver::residual_of(SchurOperator& schur, const Vector& x) const {
  Vector product(x.size());
  apply(schur, x, product);
  for (std::size_t k = 0; k < product.size(); ++k) product[k] = rhs_[k] - product[k];
  return product;
}

void IterativeSolver::apply(SchurOperator& schur, const Vector& x, Vector& out) const {
  for (std::size_t k = 0; k < out.size(); ++k)
    out[k] = normal_.exchange().is_root() ? diagonal_[k] * x[k] : 0.0;
  schur.add_product(x, out);
  normal_.exchange().sum(out);
  normal_.camera_terms().add_product(normal_.map(), x, out);
}

}  // namespace sfmcpp::linear

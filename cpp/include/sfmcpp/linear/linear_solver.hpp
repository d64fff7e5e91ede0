// Linear solvers of the damped normal equations (JᵀJ + λD) δ = Jᵀ r, all by the Schur complement:
//   dense      S formed, dense Cholesky
//   sparse     S formed, sparse Cholesky on the analysed block pattern
//   iterative  conjugate gradients; S in blocks of single precision where that costs less than to
//              multiply from the Jacobian, else never formed
#pragma once

#include <array>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "sfmcpp/core/enum_names.hpp"
#include "sfmcpp/linear/normal_equations.hpp"
#include "sfmcpp/linear/reduced_structure.hpp"
#include "sfmcpp/linear/solver_costs.hpp"

namespace sfmcpp {

namespace linear {
enum class LinearSolverKind { kAuto, kDense, kSparse, kIterative };
// Of the iterative solver.
enum class PreconditionerKind { kAuto, kSchurJacobi, kClusters, kTwoLevels };
}  // namespace linear

template <>
struct EnumTraits<linear::LinearSolverKind> {
  static constexpr std::string_view kWhat = "linear_solver";
  static constexpr auto kTable = std::to_array<EnumRow<linear::LinearSolverKind>>(
      {{linear::LinearSolverKind::kAuto, "auto", "whichever is predicted to cost least"},
       {linear::LinearSolverKind::kDense, "dense", "dense Cholesky of the Schur complement"},
       {linear::LinearSolverKind::kSparse, "sparse", "sparse Cholesky of the Schur complement"},
       {linear::LinearSolverKind::kIterative,
        "iterative",
        "preconditioned conjugate gradients on the Schur complement"}});
};

template <>
struct EnumTraits<linear::PreconditionerKind> {
  static constexpr std::string_view kWhat = "preconditioner";
  static constexpr auto kTable = std::to_array<EnumRow<linear::PreconditionerKind>>(
      {{linear::PreconditionerKind::kAuto,
        "auto",
        "schur-jacobi, or clusters for many cameras; the neighbourhoods of two-levels too from the "
        "first step of many iterations on, where the Schur complement is formed in blocks"},
       {linear::PreconditionerKind::kSchurJacobi,
        "schur-jacobi",
        "the blocks of single cameras of the Schur complement"},
       {linear::PreconditionerKind::kClusters,
        "clusters",
        "its blocks of clusters of cameras that see many points in common"},
       {linear::PreconditionerKind::kTwoLevels,
        "two-levels",
        "those, and neighbourhoods of cameras that move as one"}});
};

namespace linear {

// Whether it is made of blocks of S of several cameras.
constexpr bool needs_blocks(PreconditionerKind kind) {
  return kind == PreconditionerKind::kClusters || kind == PreconditionerKind::kTwoLevels;
}

struct LinearSolverOptions {
  LinearSolverKind kind = LinearSolverKind::kAuto;
  // Relative residual of the reduced system at which the iterative solver stops; none: by the
  // forcing sequence (inexact Newton).
  std::optional<double> pcg_tolerance = std::nullopt;
  int pcg_max_iterations = 500;
  double pcg_forcing = 5e-3;  // conjugate_gradient.hpp
  PreconditionerKind preconditioner = PreconditionerKind::kAuto;
  // Limit on the memory of a solve besides the problem itself; none: a share of the machine's
  // memory, for matrices alone.
  std::optional<double> max_memory_bytes{};
};

struct LinearSolveResult {
  bool success = false;  // false: not positive definite, or not finite
  int iterations = 0;    // of the iterative solver
};

// What a solver was replaced by when steps had cost more than predicted.
struct SolverChange {
  int solves = 0;  // before it
  LinearSolverKind kind{};
  std::string reason{};
};

// What moves: all unknowns, or the points while the cameras stay.
enum class Unknowns { kAll, kPoints };

class LinearSolver {
 public:
  virtual ~LinearSolver() = default;
  // Solves for the linearisation that the normal equations hold now. `should_stop` is asked from
  // time to time by long solves; once true, the best solution so far is returned. A StopWatcher of
  // the pool ends a solve wherever it is, and leaves the solver unusable.
  virtual LinearSolveResult solve(const Damping& damping,
                                  Step& step,
                                  const std::function<bool()>& should_stop) = 0;
  // Whether the normal equations are to hold modes (world_motions.hpp).
  virtual bool wants_camera_modes() const { return false; }
  // What a solver carries from one solve to the next: the iterations that each took. Another of the
  // same choice that replays them goes on with the same bits. Empty where it carries nothing.
  virtual std::vector<int> iterations_of_solves() const { return {}; }
  virtual void replay(const std::vector<int>& /*iterations_of_solves*/) {}
  // So far, for the summary.
  virtual std::vector<SolverChange> changes() const { return {}; }
  // Whether it keeps its factors, so that another right-hand side costs little.
  virtual bool can_solve_again(Unknowns) const { return false; }
  // The step that solves the system of the last `solve` with Jᵀ h on its right, for other residuals
  // h of the observations, two each; those of constraints are taken as zero. False: not finite.
  virtual bool solve_again(Unknowns, std::span<const double> /*residuals*/, Step& /*step*/) {
    return false;
  }
};

// What was chosen, and why, in words for the summary.
struct LinearSolverChoice {
  LinearSolverKind kind{};
  std::string reason{};
  bool with_blocks = false;  // of an iterative solver: with S in blocks
  // Of the reduced system, where the choice had to know it.
  std::shared_ptr<const ReducedStructure> structure{};
  SolverCounts counts{};
  std::vector<SolverForecast> forecasts{};  // of every solver whose cost had to be known
  double held_bytes = 0.0;                  // by all but the solver
  double budget_bytes = 0.0;                // for the solver
};

// A problem as the choice of a solver sees it.
struct SolverQuestion {
  const ObservationGraph& graph;
  const ParameterMap& map;
  ThreadPool& pool;
  const CameraPairs& pairs;
  Exchange& exchange;
  double held_bytes = 0.0;               // by all but the solver, whichever is chosen; of this rank
  double number_bytes = sizeof(double);  // of an entry of the Jacobian
};

// For methods without a linear solver, which a limit could replace: throws InvalidArgument if what
// the solve holds beside one is more than max_memory_bytes on any rank.
void require_memory(const LinearSolverOptions& options, double held_bytes, Exchange& exchange);

// `auto`: by predicted cost and memory, for the points of all ranks: by counts and reference rates,
// hence the same for every run and every number of threads. Any other kind is returned as it is.
// Throws InvalidArgument where max_memory_bytes does not hold the kind asked for, or any.
LinearSolverChoice choose_linear_solver(const SolverQuestion& question,
                                        const LinearSolverOptions& options);

// `kind` of the options must not be auto. The normal equations must outlive the solver.
// `structure`: that of the choice; where it is null the solver makes what it needs of it.
std::unique_ptr<LinearSolver> make_linear_solver(
    const NormalEquations& normal,
    const LinearSolverOptions& options,
    std::shared_ptr<const ReducedStructure> structure = nullptr);

// The solver of a choice. One that `auto` has chosen hands over to another when its steps cost more
// than that one's would; by counts, not by time.
std::unique_ptr<LinearSolver> make_chosen_solver(const NormalEquations& normal,
                                                 const LinearSolverOptions& options,
                                                 const LinearSolverChoice& choice);

}  // namespace linear
}  // namespace sfmcpp

// The number of conjugate gradient iterations of a step cannot be predicted from counts of the
// problem. So an iterative solver that was chosen for its expected cost is compared with what its
// steps really take: once they have lost too much against another solver, that one takes over. The
// decision is by counts at reference rates, and hence the same on every rank, for every run and
// number of threads.
#include <algorithm>
#include <limits>

#include "sfmcpp/linear/linear_solver.hpp"
#include "solver_choice.hpp"

namespace sfmcpp::linear {
namespace {

// The other solver takes over when steps have lost more than this against it, in all, in steps of
// the other. One slow step says little of the next: on photo collections 91 iterations, then 4.
constexpr double kPatience = 0.4;
// A single step is cut short when it has cost so many of the other's: it is the last then.
constexpr double kLongestStep = 1.5;
constexpr int kLeastIterations = 20;

class ChangingSolver final : public LinearSolver {
 public:
  ChangingSolver(const NormalEquations& normal,
                 const LinearSolverOptions& options,
                 LinearSolverChoice choice)
      : normal_(normal), options_(options), choice_(std::move(choice)) {
    make();
  }

  LinearSolveResult solve(const Damping& damping,
                          Step& step,
                          const std::function<bool()>& should_stop) override {
    const LinearSolveResult result = solver_->solve(damping, step, should_stop);
    has_factors_ = result.success;
    learn(result.iterations);
    return result;
  }

  std::vector<int> iterations_of_solves() const override { return iterations_of_solves_; }
  void replay(const std::vector<int>& iterations_of_solves) override {
    for (int iterations : iterations_of_solves) {
      solver_->replay({iterations});
      learn(iterations);
    }
  }

  bool can_solve_again(Unknowns unknowns) const override {
    return has_factors_ && solver_->can_solve_again(unknowns);
  }
  bool solve_again(Unknowns unknowns, std::span<const double> residuals, Step& step) override {
    return solver_->solve_again(unknowns, residuals, step);
  }

  std::vector<SolverChange> changes() const override { return changes_; }
  bool wants_camera_modes() const override { return solver_->wants_camera_modes(); }

 private:
  void make() {
    LinearSolverOptions options = options_;
    if (choice_.kind == LinearSolverKind::kIterative) {
      options.pcg_max_iterations =
          std::min(options.pcg_max_iterations, iterations_worth_another_solver());
    }
    has_factors_ = false;
    solver_ = make_as_chosen(normal_, options, choice_);
  }

  // The cheapest that fits, as far as it is known now.
  SolverForecast best_direct() const {
    const SolverForecast dense = forecast_dense(choice_.counts);
    const SolverForecast sparse = forecast_sparse(choice_.counts);
    const bool sparse_fits =
        choice_.counts.columns > kAlwaysDense && sparse.bytes < choice_.budget_bytes;
    return sparse_fits && (dense.bytes > choice_.budget_bytes ||
                           reference_seconds(sparse) < reference_seconds(dense))
               ? sparse
               : dense;
  }

  int iterations_worth_another_solver() const {
    const SolverForecast direct = best_direct();
    if (direct.bytes > choice_.budget_bytes) return std::numeric_limits<int>::max();
    return std::max(kLeastIterations,
                    iterations_within(forecast_iterative(choice_.counts, choice_.with_blocks),
                                      kLongestStep * reference_seconds(direct)));
  }

  // What steps have cost more than those of a direct solver. Gains make up for losses before them,
  // not for later ones.
  double loss(double direct_seconds) const {
    SolverForecast iterative = forecast_iterative(choice_.counts, choice_.with_blocks);
    double seconds = 0.0;
    for (int iterations : iterations_of_solves_) {
      iterative.iterations = iterations;
      seconds = std::max(0.0, seconds + reference_seconds(iterative) - direct_seconds);
    }
    return seconds;
  }

  bool is_worthwhile() const {
    const SolverForecast direct = best_direct();
    const double seconds = reference_seconds(direct);
    return direct.bytes < choice_.budget_bytes && loss(seconds) > kPatience * seconds;
  }

  void learn(int iterations) {
    iterations_of_solves_.push_back(iterations);
    if (choice_.kind == LinearSolverKind::kIterative) reconsider(iterations);
  }

  void reconsider(int iterations) {
    if (!is_worthwhile()) return;
    if (best_direct().kind == LinearSolverKind::kSparse && !analysed_) {
      analyse_structure(question_of(normal_), choice_);
      analysed_ = true;
      if (!is_worthwhile()) return make();  // with what is known now
    }
    choice_.kind = best_direct().kind;
    changes_.push_back({.solves = static_cast<int>(iterations_of_solves_.size()),
                        .kind = choice_.kind,
                        .reason = "a step took " + std::to_string(iterations) +
                                  " iterations of conjugate gradients"});
    solver_.reset();
    make();
  }

  const NormalEquations& normal_;
  LinearSolverOptions options_;
  LinearSolverChoice choice_;
  std::unique_ptr<LinearSolver> solver_;
  bool has_factors_ = false;  // of the last solve: none where the solver has changed after it
  std::vector<int> iterations_of_solves_;
  bool analysed_ = false;
  std::vector<SolverChange> changes_;
};

}  // namespace

std::unique_ptr<LinearSolver> make_chosen_solver(const NormalEquations& normal,
                                                 const LinearSolverOptions& options,
                                                 const LinearSolverChoice& choice) {
  if (options.kind == LinearSolverKind::kAuto && choice.kind == LinearSolverKind::kIterative)
    return std::make_unique<ChangingSolver>(normal, options, choice);
  return make_as_chosen(normal, options, choice);
}

}  // namespace sfmcpp::linear

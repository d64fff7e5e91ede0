// Parts of the choice of a linear solver (linear_solver.hpp) that changing_solver.cpp uses again.
#pragma once

#include "sfmcpp/linear/linear_solver.hpp"

namespace sfmcpp::linear {

// Of no more columns the whole matrix costs less than analysing it.
inline constexpr double kAlwaysDense = 300;

// What forecasts are compared by: the same on every machine.
double reference_seconds(const SolverForecast& forecast);
// Iterations of conjugate gradients that an iterative solver may take within so many of these
// seconds; negative: none, and not without any.
int iterations_within(SolverForecast iterative, double seconds);

// For normal equations that exist: no further memory is to be counted.
SolverQuestion question_of(const NormalEquations& normal);
// What is known without an analysis.
SolverCounts count(const SolverQuestion& question);
// Counts the blocks of S, and finds an order of elimination, in so far as the choice has not.
void find_blocks(const SolverQuestion& question, LinearSolverChoice& choice);
void analyse_structure(const SolverQuestion& question, LinearSolverChoice& choice);

std::unique_ptr<LinearSolver> make_as_chosen(const NormalEquations& normal,
                                             LinearSolverOptions options,
                                             const LinearSolverChoice& choice);

}  // namespace sfmcpp::linear

// The line searches; make_line_search chooses among them. No length is ever zero: where nothing
// decreases the cost the minimiser is to reject the step. Along a direction that does not descend
// (algebraic searches apart) it is the unit length, without an evaluation.
#pragma once

#include "sfmcpp/optim/line_search.hpp"

namespace sfmcpp::optim {

// G-ALS and T-ALS: stationary points of the algebraic cost, one common length (thesis §4.3.2) or
// two (§4.3.3), selected by the true cost (algorithms 6 and 7). The unit step where none is better,
// and where there is no algebraic cost. Lengths may be negative.
std::unique_ptr<LineSearch> make_global_algebraic_search();
std::unique_ptr<LineSearch> make_two_way_algebraic_search();

// Frandsen, Jonasson, Nielsen, Tingleff: Unconstrained Optimization, IMM DTU 1999: exact and soft.
// Lengths in (0, 10], ten evaluations at most; never worse than the unit step.
std::unique_ptr<LineSearch> make_exact_search();
std::unique_ptr<LineSearch> make_soft_search();

// From the unit length, until the test holds (thesis §2.2.2.3, eqs 2.37, 2.39 and 2.40); after
// twenty evaluations the best length seen. Goldstein's test refuses also a unit step that decreases
// the cost by more than three quarters of what the tangent promises.
std::unique_ptr<LineSearch> make_backtracking_search(BacktrackingTest test);

}  // namespace sfmcpp::optim

// The line searches, and all that is known of each, in one table. No length is ever zero: where
// nothing decreases the cost the minimiser is to reject the step. Along a direction that does not
// descend (algebraic searches apart) it is the unit length, without an evaluation.
//
// How to add a line search: a class in a file of its own under src/optim (optim/line_search.hpp),
// an enumerator with its factory and its row here.
#pragma once

#include <array>
#include <memory>
#include <string_view>

#include "sfmcpp/core/enum_names.hpp"

namespace sfmcpp {

namespace optim {

class LineSearch;
struct LineSearchOptions;

enum class LineSearchKind {
  kNone,
  kGlobalAlgebraic,
  kTwoWayAlgebraic,
  kExact,
  kSoft,
  kBacktracking
};

using LineSearchFactory = std::unique_ptr<LineSearch>(const LineSearchOptions& options);

// G-ALS and T-ALS: stationary points of the algebraic cost, one common length (thesis §4.3.2) or
// two (§4.3.3), selected by the true cost (algorithms 6 and 7). The unit step where none is better,
// and where there is no algebraic cost. Lengths may be negative.
LineSearchFactory make_global_algebraic_search, make_two_way_algebraic_search;

// Frandsen, Jonasson, Nielsen, Tingleff: Unconstrained Optimization, IMM DTU 1999: exact and soft.
// Lengths in (0, 10], ten evaluations at most; never worse than the unit step.
LineSearchFactory make_exact_search, make_soft_search;

// From the unit length, until the test holds (thesis §2.2.2.3, eqs 2.37, 2.39 and 2.40); after
// twenty evaluations the best length seen. Goldstein's test refuses also a unit step that decreases
// the cost by more than three quarters of what the tangent promises.
LineSearchFactory make_backtracking_search;

struct LineSearchFacts {
  LineSearchKind value;
  std::string_view name;
  std::string_view description;
  LineSearchFactory* make = nullptr;  // null: every step has unit length
};

enum class BacktrackingTest { kArmijo, kStrongWolfe, kGoldstein };

}  // namespace optim

template <>
struct EnumTraits<optim::LineSearchKind> {
  using K = optim::LineSearchKind;
  static constexpr std::string_view kWhat = "line_search";
  static constexpr auto kTable = std::to_array<optim::LineSearchFacts>(
      {{K::kNone, "none", "the unit step"},
       {K::kGlobalAlgebraic,
        "g-als",
        "algebraic, one length (thesis §4.3.2)",
        optim::make_global_algebraic_search},
       {K::kTwoWayAlgebraic,
        "t-als",
        "algebraic, a length for cameras and one for points (thesis §4.3.3)",
        optim::make_two_way_algebraic_search},
       {K::kExact, "exact", "Frandsen's exact search", optim::make_exact_search},
       {K::kSoft, "soft", "Frandsen's soft search", optim::make_soft_search},
       {K::kBacktracking, "backtracking", "backtracking", optim::make_backtracking_search}});
};

template <>
struct EnumTraits<optim::BacktrackingTest> {
  using T = optim::BacktrackingTest;
  static constexpr std::string_view kWhat = "backtracking_test";
  static constexpr auto kTable =
      std::to_array<EnumRow<T>>({{T::kArmijo, "armijo", "sufficient decrease"},
                                 {T::kStrongWolfe,
                                  "strong-wolfe",
                                  "sufficient decrease and the strong condition on the slope"},
                                 {T::kGoldstein,
                                  "goldstein",
                                  "a decrease neither too small nor too close to the tangent's"}});
};

}  // namespace sfmcpp

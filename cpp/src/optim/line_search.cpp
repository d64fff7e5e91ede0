#include "sfmcpp/optim/line_search.hpp"

#include "sfmcpp/optim/line_searches.hpp"

namespace sfmcpp::optim {

std::unique_ptr<LineSearch> make_line_search(const LineSearchOptions& options) {
  switch (options.kind) {
    case LineSearchKind::kNone:
      return nullptr;
    case LineSearchKind::kGlobalAlgebraic:
      return make_global_algebraic_search();
    case LineSearchKind::kTwoWayAlgebraic:
      return make_two_way_algebraic_search();
    case LineSearchKind::kExact:
      return make_exact_search();
    case LineSearchKind::kSoft:
      return make_soft_search();
    case LineSearchKind::kBacktracking:
      return make_backtracking_search(options.backtracking_test);
  }
  return nullptr;
}

}  // namespace sfmcpp::optim

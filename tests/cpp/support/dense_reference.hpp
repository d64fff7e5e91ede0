// The full Jacobian of a problem as one dense matrix, made from the double-typed camera templates
// without any code of linear/.
#pragma once

#include "sfmcpp/residuals/loss.hpp"
#include "support/dense_system.hpp"
#include "support/linearized_problem.hpp"

namespace sfmcpp::support {

// Rows: two per observation in the caller's order, over σ or whitened.
DenseSystem make_dense_system(const LinearizedProblem& linearized, const Loss& loss = {});

}  // namespace sfmcpp::support

// Preconditioned conjugate gradients for a symmetric positive definite system.
#pragma once

#include <functional>
#include <vector>

#include "sfmcpp/core/exchange.hpp"
#include "sfmcpp/core/parallel.hpp"

namespace sfmcpp::linear {

struct ConjugateGradientOptions {
  // Of the residual, relative to b in the norm of the preconditioner's inverse.
  double tolerance = 1e-2;
  // Stop too at iteration i when it lowers the quadratic model Q(x) = ½ xᵀA x − bᵀx by less than
  // this share of what an average one of the i did: i (Qᵢ − Qᵢ₋₁) < forcing · Qᵢ (Nash & Sofer
  // 1990, eq. 13). Zero: never.
  double forcing = 0.0;
  int max_iterations = 500;
};

struct ConjugateGradientResult {
  int iterations = 0;
  bool finite = true;
  bool stopped = false;  // by `should_stop`
};

using LinearMap = std::function<void(const std::vector<double>& in, std::vector<double>& out)>;

// For one system after another: vectors are kept.
class ConjugateGradients {
 public:
  // The references must outlive this object. Vectors may be distributed over the ranks of an
  // exchange, each of which holds some of their entries.
  explicit ConjugateGradients(ThreadPool& pool, Exchange& exchange = this_process())
      : pool_(pool), exchange_(exchange) {}

  // Solves A x = b from x = 0, until a rule of the options or `should_stop`.
  ConjugateGradientResult solve(const LinearMap& a,
                                const LinearMap& preconditioner,
                                const std::vector<double>& b,
                                const ConjugateGradientOptions& options,
                                const std::function<bool()>& should_stop,
                                std::vector<double>& x);

 private:
  double product(const std::vector<double>& u, const std::vector<double>& v) const;

  ThreadPool& pool_;
  Exchange& exchange_;
  std::vector<double> residual_, z_, direction_, a_direction_;
};

}  // namespace sfmcpp::linear

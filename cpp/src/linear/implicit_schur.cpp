#include "implicit_schur.hpp"

#include <algorithm>

#include "sfmcpp/linear/conjugate_gradient.hpp"

namespace sfmcpp::linear {

ImplicitSchurSolver::ImplicitSchurSolver(const NormalEquations& normal,
                                         const LinearSolverOptions& options)
    : normal_(normal), options_(options), elimination_(normal), preconditioner_(normal) {
  shifts_.resize(3 * static_cast<std::size_t>(normal.graph().num_points));
  chunk_sums_.resize(normal.graph().chunks.size() *
                     static_cast<std::size_t>(normal.map().camera_size));
}

LinearSolveResult ImplicitSchurSolver::solve(const Damping& damping,
                                             Step& step,
                                             const std::function<bool()>& should_stop) {
  elimination_.factor(damping);
  diagonal_ = normal_.camera_damping(damping);
  preconditioner_.assemble(elimination_.factors(), rhs_);
  preconditioner_.factor(diagonal_);
  const ConjugateGradientResult result = conjugate_gradient(
      normal_.pool(),
      [this](const auto& in, auto& out) { apply(in, out); },
      [this](const auto& in, auto& out) { preconditioner_.solve(in, out); },
      rhs_,
      options_.pcg_tolerance,
      options_.pcg_max_iterations,
      should_stop,
      step.camera);
  if (!result.finite) return {.success = false, .iterations = result.iterations};
  elimination_.back_substitute(step);
  return {.success = true, .iterations = result.iterations};
}

void ImplicitSchurSolver::set_shifts(const double* sums) {
  for_each_point(normal_.pool(), normal_.graph().num_points, [&](int p) {
    multiply_by_transposed_factor(elimination_.factor(p), sums + 3L * p, shifts_.data() + 3L * p);
  });
}

void ImplicitSchurSolver::apply(const std::vector<double>& x, std::vector<double>& out) {
  const ParameterMap& map = normal_.map();
  const ObservationGraph& graph = normal_.graph();
  const long size = map.camera_size;
  set_shifts(elimination_.point_sums(x));
  normal_.pool().parallel_for(static_cast<int>(graph.chunks.size()), [&](int chunk) {
    const Chunk& c = graph.chunks[chunk];
    double* sum = chunk_sums_.data() + size * chunk;
    std::fill_n(sum, size, 0.0);
    normal_.kernels().schur_product(c.end - c.begin,
                                    normal_.jacobian() + 2 * size * c.begin,
                                    normal_.records() + c.begin,
                                    graph.point.data() + c.begin,
                                    shifts_.data(),
                                    elimination_.expanded(c.camera),
                                    sum);
  });
  for (std::size_t k = 0; k < out.size(); ++k)
    out[k] = normal_.exchange().is_root() ? diagonal_[k] * x[k] : 0.0;
  normal_.fold_chunks(chunk_sums_.data(), size, out.data());
  normal_.exchange().sum(out);
  normal_.camera_terms().add_product(map, x, out);
}

}  // namespace sfmcpp::linear

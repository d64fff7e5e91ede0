#include "sfmcpp/linear/block_jacobi.hpp"

namespace sfmcpp::linear {

BlockJacobi::BlockJacobi(const NormalEquations& normal)
    : normal_(normal), cameras_(normal), points_(normal) {
  no_factors_.assign(static_cast<std::size_t>(normal.graph().num_points), PointFactor{});
}

void BlockJacobi::factor(const Damping& damping) {
  cameras_.assemble(no_factors_.data(), camera_rhs_);
  cameras_.factor(normal_.camera_damping(damping));
  points_.factor(damping);
}

void BlockJacobi::solve(const Step& g, Step& step) const {
  cameras_.solve(g.camera, step.camera);
  points_.solve(g.point, step.point);
}

void BlockJacobi::sweep(Step& step) {
  cameras_.solve(camera_rhs_, step.camera);
  points_.back_substitute(step);
}

}  // namespace sfmcpp::linear

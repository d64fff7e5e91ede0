#include "sfmcpp/linear/point_elimination.hpp"

#include <algorithm>

#include "sfmcpp/core/isa.hpp"

namespace sfmcpp::linear {

PointElimination::PointElimination(const NormalEquations& normal)
    : normal_(normal), factor_points_(SFMCPP_FOR_ACTIVE_ISA(factor_points_kernel())) {
  const ObservationGraph& graph = normal.graph();
  factors_.resize(static_cast<std::size_t>(graph.num_points));
  steps_.resize(static_cast<std::size_t>(graph.num_cameras) * normal.map().camera_size);
  sums_.resize(3 * static_cast<std::size_t>(graph.num_points));
}

void PointElimination::factor(const Damping& damping) {
  static_assert(sizeof(PointBlock) == sizeof(PointFactor));
  const std::vector<char>& is_free = normal_.map().free_point;
  const bool identity = damping.matrix == DampingMatrix::kIdentity;
  for_points(normal_.pool(), normal_.graph().num_points, [&](int begin, int end) {
    factor_points_(end - begin,
                   &normal_.point_block(begin).v00,
                   damping.lambda,
                   identity,
                   factors_.data() + begin);
    for (int p = begin; p < end; ++p) {
      if (!is_free[p]) factors_[p] = PointFactor{};
    }
  });
}

const double* PointElimination::expanded(int i) const {
  return steps_.data() + static_cast<long>(normal_.map().camera_size) * i;
}

const double* PointElimination::point_sums(const std::vector<double>& x) {
  const ObservationGraph& graph = normal_.graph();
  const ParameterMap& map = normal_.map();
  for_each_camera(normal_.pool(), graph.num_cameras, [&](int i) {
    map.expand(x.data(), i, steps_.data() + long{map.camera_size} * i);
  });
  for_points(normal_.pool(), graph.num_points, [&](int begin, int end) {
    normal_.kernels().point_sums(graph.view(),
                                 begin,
                                 end,
                                 normal_.jacobian(),
                                 factors_.data(),
                                 steps_.data(),
                                 sums_.data() + 3L * begin);
  });
  return sums_.data();
}

void PointElimination::solve(const std::vector<double>& g, std::vector<double>& x) const {
  x.resize(g.size());
  for_each_point(normal_.pool(), normal_.graph().num_points, [&](int p) {
    solve_point(factor(p), g.data() + 3L * p, x.data() + 3L * p);
  });
}

void PointElimination::back_substitute(Step& step) {
  const double* sums = point_sums(step.camera);
  step.point.resize(sums_.size());
  for_each_point(normal_.pool(), normal_.graph().num_points, [&](int p) {
    const PointFactor& m = factor(p);
    const double* sum = sums + 3L * p;
    const double z[3] = {m.y[0] - sum[0], m.y[1] - sum[1], m.y[2] - sum[2]};
    multiply_by_transposed_factor(m, z, step.point.data() + 3L * p);
  });
}

OtherResiduals::OtherResiduals(const NormalEquations& normal, PointElimination& elimination)
    : normal_(normal), elimination_(elimination) {}

void OtherResiduals::solve_points(std::span<const double> residuals, Step& step) {
  step.camera.assign(normal_.map().num_columns, 0.0);
  step.point.resize(3 * static_cast<std::size_t>(normal_.graph().num_points));
  eliminate(residuals, step.point.data());
}

void OtherResiduals::eliminate(std::span<const double> residuals, double* shifts) {
  const ObservationGraph& graph = normal_.graph();
  for_points(normal_.pool(), graph.num_points, [&](int begin, int end) {
    double* x = shifts + 3L * begin;
    normal_.kernels().point_gradients(
        graph.view(), begin, end, normal_.jacobian(), residuals.data(), x);
    for (int p = begin; p < end; ++p, x += 3) solve_point(elimination_.factor(p), x, x);
  });
}

void OtherResiduals::reduce(std::span<const double> residuals, std::vector<double>& rhs) {
  const ObservationGraph& graph = normal_.graph();
  const long size = normal_.map().camera_size;
  shifts_.resize(3 * static_cast<std::size_t>(graph.num_points));
  eliminate(residuals, shifts_.data());
  chunk_sums_.resize(graph.chunks.size() * static_cast<std::size_t>(size));
  normal_.pool().parallel_for(static_cast<int>(graph.chunks.size()), [&](int chunk) {
    const Chunk& c = graph.chunks[chunk];
    double* sum = chunk_sums_.data() + size * chunk;
    std::fill_n(sum, size, 0.0);
    normal_.kernels().reduced_gradient(normal_.jacobian(),
                                       c.begin,
                                       c.end,
                                       graph.point.data(),
                                       shifts_.data(),
                                       residuals.data(),
                                       sum);
  });
  rhs.assign(normal_.map().num_columns, 0.0);
  normal_.fold_chunks(chunk_sums_.data(), size, rhs.data());
  normal_.exchange().sum(rhs);
}

void OtherResiduals::back_substitute(Step& step) {
  const double* sums = elimination_.point_sums(step.camera);
  step.point.resize(shifts_.size());
  for_each_point(normal_.pool(), normal_.graph().num_points, [&](int p) {
    double* delta = step.point.data() + 3L * p;
    multiply_by_transposed_factor(elimination_.factor(p), sums + 3L * p, delta);
    for (int k = 0; k < 3; ++k) delta[k] = shifts_[3L * p + k] - delta[k];
  });
}

}  // namespace sfmcpp::linear

#include "sfmcpp/linear/other_residuals.hpp"

#include <algorithm>

namespace sfmcpp::linear {

OtherResiduals::OtherResiduals(const NormalEquations& normal, PointElimination& elimination)
    : normal_(normal), elimination_(elimination) {}

void OtherResiduals::solve_points(const std::vector<double>& residuals, Step& step) {
  step.camera.assign(normal_.map().num_columns, 0.0);
  eliminate(residuals, step.point);
}

void OtherResiduals::eliminate(const std::vector<double>& residuals, std::vector<double>& shifts) {
  const ObservationGraph& graph = normal_.graph();
  shifts.resize(3 * static_cast<std::size_t>(graph.num_points));
  normal_.pool().parallel_for(num_point_tasks(graph.num_points), [&](int task) {
    const int begin = task * kPointsPerTask;
    const int end = std::min(begin + kPointsPerTask, graph.num_points);
    double* x = shifts.data() + 3L * begin;
    normal_.kernels().point_gradients(
        graph.view(), begin, end, normal_.jacobian(), residuals.data(), x);
    for (int p = begin; p < end; ++p, x += 3) solve_point(elimination_.factor(p), x, x);
  });
}

void OtherResiduals::reduce(const std::vector<double>& residuals, std::vector<double>& rhs) {
  const ObservationGraph& graph = normal_.graph();
  const long size = normal_.map().camera_size;
  eliminate(residuals, shifts_);
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

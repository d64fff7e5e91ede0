// The slope of the cost along a step, away from where it starts: for line searches that test it.
#include "sfmcpp/ba/bundle_model.hpp"
#include "sfmcpp/cameras/visit_camera.hpp"

namespace sfmcpp::ba {
namespace {

// The points' part of a step as the tangents of `candidate` have it.
std::vector<double> transported(const Problem& problem,
                                const optim::State& start,
                                const linear::Step& step,
                                const optim::State& candidate) {
  std::vector<double> result(step.point.size());
  const long storage = problem.point_storage();
  visit_camera(problem.camera_model, [&](auto camera) {
    for (int p = 0; p < problem.num_points(); ++p) {
      decltype(camera)::transport(start.points.data() + storage * p,
                                  step.point.data() + static_cast<long>(kPointTangent) * p,
                                  candidate.points.data() + storage * p,
                                  result.data() + static_cast<long>(kPointTangent) * p);
    }
  });
  return result;
}

// r · J δ of one observation, from its records.
double along(const double* jacobian,
             int camera_size,
             const linear::PointRecord& record,
             const double* camera_step,
             const double* point_step) {
  double sum = 0.0;
  for (int row = 0; row < 2; ++row) {
    double moved = 0.0;
    for (int k = 0; k < camera_size; ++k) moved += jacobian[row * camera_size + k] * camera_step[k];
    const auto& [by_point, residual] = record.row[row];
    for (int k = 0; k < kPointTangent; ++k) moved += by_point[k] * point_step[k];
    sum += residual * moved;
  }
  return sum;
}

}  // namespace

double BundleModel::slope(const optim::State& start,
                          const linear::Step& step,
                          const optim::State& candidate) {
  const linear::Step here{step.camera, transported(problem_, start, step, candidate)};
  const double observed = -pool_.sum(static_cast<int>(graph_.chunks.size()),
                                     [&](int c) { return chunk_slope(candidate, here, c); });
  return observed + constraints_.slope(candidate, step.camera);
}

double BundleModel::chunk_slope(const optim::State& state, const linear::Step& step, int c) const {
  const linear::Chunk& chunk = graph_.chunks[c];
  const int count = chunk.end - chunk.begin, size = map_.camera_size;
  std::vector<double> jacobians(2 * static_cast<std::size_t>(size) * count);
  std::vector<linear::PointRecord> records(count);
  kernels_.linearize(batch(state, chunk),
                     jacobian_output(jacobians.data(), records.data()->row[0].by_point));
  std::vector<double> camera_step(size);
  map_.expand(step.camera.data(), chunk.camera, camera_step.data());
  double sum = 0.0;
  for (int k = 0; k < count; ++k) {
    const linear::PointRecord& record = records[k];
    const double ru = record.row[0].residual, rv = record.row[1].residual;
    const double weight = loss_.derivative(ru * ru + rv * rv);
    const long p = graph_.point[chunk.begin + k];
    sum += weight * along(jacobians.data() + 2L * size * k,
                          size,
                          record,
                          camera_step.data(),
                          step.point.data() + kPointTangent * p);
  }
  return sum;
}

}  // namespace sfmcpp::ba

#include "sfmcpp/optim/geodesic_acceleration.hpp"

#include <array>
#include <cmath>
#include <limits>

#include "sfmcpp/optim/options.hpp"

namespace sfmcpp::optim {
namespace {

// ‖a‖ may be this many times ‖v‖, of each point and block of cameras.
constexpr double kLongest = 0.7;
// Near a minimum steps are straight, and bending them costs more than it gains.
constexpr double kSteep = 1.0 / 3.0;

double squared_length(const double* x, const double* diagonal, long n) {
  double sum = 0.0;
  for (long k = 0; k < n; ++k) sum += x[k] * x[k] * diagonal[k];
  return sum;
}

// bent ← v + ½ a of one point or block of n unknowns, with −a in `bent` before.
inline void add_acceleration(const double* step, const double* diagonal, long n, double* bent) {
  const double longest = kLongest * kLongest * squared_length(step, diagonal, n);
  const double length = squared_length(bent, diagonal, n);
  const double half = length > longest ? 0.5 * std::sqrt(longest / length) : 0.5;
  for (long k = 0; k < n; ++k) bent[k] = step[k] - half * bent[k];
}

void add_to_points(const linear::NormalEquations& normal,
                   const linear::Step& step,
                   linear::Step& bent) {
  const linear::Damping unit{1.0, linear::DampingMatrix::kDiagonal};
  linear::for_each_point(normal.pool(), normal.graph().num_points, [&](int p) {
    std::array<double, 3> diagonal = normal.point_block(p).diagonal();
    for (double& entry : diagonal) entry = unit(entry);
    add_acceleration(step.point.data() + 3L * p, diagonal.data(), 3, bent.point.data() + 3L * p);
  });
}

void add_to_cameras(const linear::NormalEquations& normal,
                    const linear::Step& step,
                    linear::Step& bent) {
  const std::vector<double> diagonal =
      normal.camera_damping({1.0, linear::DampingMatrix::kDiagonal});
  const linear::ParameterMap& map = normal.map();
  for (int block = 0; block < map.num_blocks(); ++block) {
    const int first = map.block_begin[block];
    add_acceleration(step.camera.data() + first,
                     diagonal.data() + first,
                     map.block_begin[block + 1] - first,
                     bent.camera.data() + first);
  }
}

}  // namespace

GeodesicAcceleration::GeodesicAcceleration(const MinimizerOptions& options)
    : possible_(options.acceleration != Acceleration::kNone &&
                facts_of(options.method).solves_damped_system() &&
                options.line_search.kind == LineSearchKind::kNone),
      largest_share_(options.acceleration == Acceleration::kAuto
                         ? kSteep
                         : std::numeric_limits<double>::infinity()),
      unknowns_(options.acceleration == Acceleration::kPoints ? linear::Unknowns::kPoints
                                                              : linear::Unknowns::kAll) {}

bool GeodesicAcceleration::is_due(const linear::LinearSolver& solver, double share_left) const {
  return possible_ && share_left < largest_share_ && solver.can_solve_again(unknowns_);
}

const linear::Step* GeodesicAcceleration::bend(LeastSquaresModel& model,
                                               linear::LinearSolver& solver,
                                               const State& state,
                                               const linear::Step& step) {
  // The model gives −r″: the solution is −a.
  if (!solver.solve_again(unknowns_, model.bending(state, step), bent_)) return nullptr;
  add_to_points(model.normal_equations(), step, bent_);
  add_to_cameras(model.normal_equations(), step, bent_);
  return &bent_;
}

}  // namespace sfmcpp::optim

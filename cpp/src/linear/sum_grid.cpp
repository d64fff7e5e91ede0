#include "sfmcpp/linear/sum_grid.hpp"

#include <algorithm>
#include <cmath>

namespace sfmcpp::linear {
namespace {

// 2^e > x
int exponent_above(double x) {
  int e = 0;
  std::frexp(x, &e);
  return e;
}

double power_of(double diagonal) {
  if (!(diagonal > 0.0) || !std::isfinite(diagonal)) return 0.0;
  return std::ldexp(1.0, exponent_above(std::sqrt(diagonal)) + 1);
}

}  // namespace

void SumGrid::set(const NormalEquations& normal) {
  const ParameterMap& map = normal.map();
  size_ = map.camera_size;
  powers_.assign(static_cast<std::size_t>(normal.graph().num_cameras * size_), 0.0);
  for (int i = 0; i < normal.graph().num_cameras; ++i) {
    const int* column = map.columns_of(i);
    for (long k = 0; k < size_; ++k) {
      if (column[k] != kNoColumn)
        powers_[size_ * i + k] = power_of(normal.camera_diagonal()[column[k]]);
    }
  }
}

void ProductGrid::set(const NormalEquations& normal, const SumGrid& grid, const double* x) {
  const long size = normal.map().camera_size;
  const int cameras = normal.graph().num_cameras;
  // |B x| of a block is at most √d of its row times the Σ √d |x| of its column.
  const double largest =
      normal.pool().max(ThreadPool::num_parts(cameras, kCamerasPerTask), [&](int task) {
        double most = 0.0;
        for (int i = task * kCamerasPerTask; i < std::min(cameras, (task + 1) * kCamerasPerTask);
             ++i) {
          double sum = 0.0;
          for (long k = 0; k < size; ++k) sum += grid.of_camera(i)[k] * std::abs(x[size * i + k]);
          most = std::max(most, sum);
        }
        return most;
      });
  const double terms = 2.0 * cameras + 2.0;  // of a sum, at most
  const double bound = normal.exchange().max(largest) * terms;
  const double scale = 1.5 * std::ldexp(1.0, std::isfinite(bound) ? exponent_above(bound) : 0);
  middles.resize(static_cast<std::size_t>(cameras * size));
  for (std::size_t k = 0; k < middles.size(); ++k) middles[k] = scale * grid.powers()[k];
  finer = std::ldexp(1.0, exponent_above(terms) - 51);
}

}  // namespace sfmcpp::linear

// The unknowns, as a value: a candidate is plus(state, step, lengths), accepting it is a swap.
#pragma once

#include <vector>

namespace sfmcpp::optim {

struct State {
  std::vector<double> cameras;     // 12 per camera, row-major 3×4
  std::vector<double> intrinsics;  // rows of intrinsic parameters
  std::vector<double> points;      // 3 per point, or 4 homogeneous
  std::vector<double> sensors{};  // of rigs: 12 per sensor, row-major 3×4; cameras agree with them
};

inline bool same_size(const State& a, const State& b) {
  return a.cameras.size() == b.cameras.size() && a.intrinsics.size() == b.intrinsics.size() &&
         a.points.size() == b.points.size() && a.sensors.size() == b.sensors.size();
}

// How far along the step cameras (with their intrinsics) and points go: two lengths, so that
// searches over one and over two lengths are the same thing (thesis §4.2.4).
struct StepLengths {
  double camera = 1.0;
  double point = 1.0;
  bool operator==(const StepLengths&) const = default;

  template <class Archive>
  void keep(Archive& archive) {
    archive.keep(camera);
    archive.keep(point);
  }
};

}  // namespace sfmcpp::optim

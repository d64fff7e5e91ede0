// A camera model given by a function from outside: poses and points are those of metric cameras,
// and the function takes points in the frame of their camera to pixels.
#pragma once

#include <span>
#include <string>
#include <string_view>

namespace sfmcpp {

class CameraFunction {
 public:
  virtual ~CameraFunction() = default;
  virtual const std::string& name() const = 0;
  virtual std::span<const std::string_view> intrinsic_names() const = 0;  // at least one

  // Where its derivatives go; row-major.
  struct Jacobians {
    double* by_point;       // count × 2 × 3
    double* by_intrinsics;  // count × 2 × K
  };
  // `points` count × 3, `intrinsics` count × K; writes `pixels`, count × 2, and, where it is not
  // null, their derivatives. A pixel that is no number is one that the camera cannot have. All that
  // is to be written is NaN before.
  virtual void image(int count,
                     const double* points,
                     const double* intrinsics,
                     double* pixels,
                     const Jacobians* jacobians) const = 0;
};

}  // namespace sfmcpp

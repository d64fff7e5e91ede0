// A lens as a function from outside (CameraFunction), and the camera that this makes as a type, for
// the laws that hold for all.
#pragma once

#include <algorithm>
#include <string>

#include "sfmcpp/cameras/camera_concept.hpp"
#include "sfmcpp/residuals/function_images.hpp"

namespace sfmcpp::support {

template <class Lens>
class LensFunction final : public CameraFunction {
 public:
  static constexpr int kIntrinsics = Lens::kIntrinsics;

  const std::string& name() const override { return name_; }
  std::span<const std::string_view> intrinsic_names() const override { return Lens::kNames; }

  void image(int count,
             const double* points,
             const double* intrinsics,
             double* pixels,
             const Jacobians* jacobians) const override {
    for (long k = 0; k < count; ++k) {
      const double *x = points + 3 * k, *own = intrinsics + kIntrinsics * k;
      LinearizedLens<double, kIntrinsics> lens;
      Lens::linearize(own, x[0] / x[2], x[1] / x[2], lens);
      pixels[2 * k] = lens.u;
      pixels[2 * k + 1] = lens.v;
      for (long row = 0; jacobians != nullptr && row < 2; ++row) {
        const auto& plane = lens.plane[row];
        double* by_point = jacobians->by_point + 3 * (2 * k + row);
        by_point[0] = plane[0] / x[2];
        by_point[1] = plane[1] / x[2];
        by_point[2] = -(plane[0] * x[0] + plane[1] * x[1]) / (x[2] * x[2]);
        std::copy_n(lens.intrinsics[row],
                    kIntrinsics,
                    jacobians->by_intrinsics + kIntrinsics * (2 * k + row));
      }
    }
  }

 private:
  std::string name_ = "lens";
};

template <class Lens>
struct FunctionCamera : MetricSpace {
  static constexpr auto kIntrinsicNames = Lens::kNames;
  static constexpr int kIntrinsics = Lens::kIntrinsics;

  template <class Real>
  static ImagePoint<double> project(const double* camera,
                                    const double* intrinsics,
                                    const double* point) {
    const LensFunction<Lens> function;
    const residuals::FunctionImages image = imaged(function, camera, intrinsics, point, false);
    double x[3];
    to_camera(camera, point, x);
    return {image.pixel(0)[0], image.pixel(0)[1], x[2]};
  }

  static void linearize(const double* camera,
                        const double* intrinsics,
                        const double* point,
                        LinearizedImagePoint<double, kTangent, kIntrinsics>& out) {
    const LensFunction<Lens> function;
    constexpr int kColumns = kTangent + kIntrinsics;
    int all[kIntrinsics];
    for (int k = 0; k < kIntrinsics; ++k) all[k] = k;
    double by_camera[2 * kColumns], by_point[8];
    imaged(function, camera, intrinsics, point, true)
        .linearize(
            0, batch(camera, intrinsics, point), {all, kIntrinsics, kColumns, by_camera, by_point});
    out.image = project<double>(camera, intrinsics, point);
    for (int row = 0; row < 2; ++row) {
      std::copy_n(by_camera + kColumns * row, kTangent, out.camera[row]);
      std::copy_n(by_camera + kColumns * row + kTangent, kIntrinsics, out.intrinsics[row]);
      std::copy_n(by_point + 4 * row, 3, out.point[row]);
    }
  }

 private:
  static residuals::ObservationBatch batch(const double* camera,
                                           const double* intrinsics,
                                           const double* point) {
    static constexpr int kFirst = 0;
    static constexpr double kZero = 0.0, kOne = 1.0;
    return {camera, intrinsics, point, &kFirst, &kZero, &kZero, &kOne, 1};
  }

  static residuals::FunctionImages imaged(const CameraFunction& function,
                                          const double* camera,
                                          const double* intrinsics,
                                          const double* point,
                                          bool with_jacobians) {
    residuals::FunctionImages image(function, 1);
    image.set(0, batch(camera, intrinsics, point));
    image.evaluate(with_jacobians);
    return image;
  }
};

}  // namespace sfmcpp::support

// The camera models by name, and what is known of them without their type.
//
// A camera is a 3×4 row-major block of 12 numbers: [R | c] for metric cameras, rotation
// world_from_camera and centre in the world (docs/equations.md §1, the note's parametrisation); the
// projection matrix itself for projective ones. A row of intrinsic parameters belongs to one camera
// or is shared by several.
//
// How to add a camera model: a struct like those beside this file (its constants, `project` and
// `linearize` for any number type, `plus`, `matrix`, `undistort`), an enumerator with its name
// here, and its line in visit_camera.hpp. The law suite in tests/cpp/cameras runs over every model.
#pragma once

#include <array>
#include <span>
#include <string_view>

#include "sfmcpp/cameras/camera_function.hpp"
#include "sfmcpp/core/enum_names.hpp"

namespace sfmcpp {

// The last is that of SFMCPP_CAMERA_PLUGIN, the header of a camera model that is given when sfmcpp
// is built (examples/plugins); it is there if it is given.
enum class CameraModelId { kCalibrated, kPerspective, kBal, kProjective, kPlugin };

template <>
struct EnumTraits<CameraModelId> {
  static constexpr std::string_view kWhat = "camera_model";
  static constexpr auto kTable =
      std::to_array<EnumRow<CameraModelId>>({{CameraModelId::kCalibrated, "calibrated"},
                                             {CameraModelId::kPerspective, "perspective"},
                                             {CameraModelId::kBal, "bal"},
                                             {CameraModelId::kProjective, "projective"},
#ifdef SFMCPP_CAMERA_PLUGIN
                                             {CameraModelId::kPlugin, SFMCPP_CAMERA_PLUGIN_NAME}
#endif
      });
};

// One of the models above, or a function.
class CameraModel {
 public:
  CameraModel(CameraModelId id) : id_(id) {}  // NOLINT(google-explicit-constructor): it is one
  explicit CameraModel(const CameraFunction& function) : function_(&function) {}  // outlives this
  explicit CameraModel(const CameraFunction&&) = delete;

  const CameraFunction* function() const { return function_; }  // null: one of the models above
  // Throws InvalidArgument that names the model if it is a function.
  CameraModelId compiled() const;
  std::string_view name() const;

 private:
  CameraModelId id_ = CameraModelId::kCalibrated;
  const CameraFunction* function_ = nullptr;
};

inline constexpr int kCameraStorage = 12;     // numbers stored for a camera
inline constexpr int kMaxCameraTangent = 12;  // of any model
inline constexpr int kMaxPointStorage = 4;
inline constexpr int kPointTangent = 3;

// Names of the intrinsic parameters, in the order they are stored.
std::span<const std::string_view> intrinsic_names(const CameraModel& model);

// Whether any intrinsic parameter of the model may be free.
bool has_free_intrinsics(const CameraModel& model);

// Whether a camera is a pose [R | c] in a Euclidean world.
bool is_metric(const CameraModel& model);

int camera_tangent(const CameraModel& model);  // columns of a camera, intrinsics aside
int point_storage(const CameraModel& model);   // numbers stored for a point; 4: homogeneous

// camera ← camera + delta, point ← point + delta, in the tangents of the model.
void plus_camera(const CameraModel& model,
                 const double* camera,
                 const double* delta,
                 double* result);
void plus_point(const CameraModel& model, const double* point, const double* delta, double* result);

// Normalises what no image depends on: the scale of homogeneous coordinates. Nothing for metric
// models.
void normalize_camera(const CameraModel& model, double* camera);
void normalize_point(const CameraModel& model, double* point);

}  // namespace sfmcpp

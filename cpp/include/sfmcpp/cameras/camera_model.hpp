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
#include <utility>

#include "sfmcpp/core/enum_names.hpp"

namespace sfmcpp {

enum class CameraModelId { kCalibrated, kPerspective, kBal, kProjective };

template <>
struct EnumTraits<CameraModelId> {
  static constexpr std::string_view kWhat = "camera_model";
  static constexpr auto kTable =
      std::to_array<EnumRow<CameraModelId>>({{CameraModelId::kCalibrated, "calibrated"},
                                             {CameraModelId::kPerspective, "perspective"},
                                             {CameraModelId::kBal, "bal"},
                                             {CameraModelId::kProjective, "projective"}});
};

inline constexpr int kCameraStorage = 12;     // numbers stored for a camera
inline constexpr int kMaxCameraTangent = 12;  // of any model
inline constexpr int kMaxPointStorage = 4;
inline constexpr int kPointTangent = 3;

// Names of the intrinsic parameters, in the order they are stored.
std::span<const std::string_view> intrinsic_names(CameraModelId model);

// Whether any intrinsic parameter of the model may be free.
bool has_free_intrinsics(CameraModelId model);

// Whether a camera is a pose [R | c] in a Euclidean world.
bool is_metric(CameraModelId model);

int camera_tangent(CameraModelId model);  // columns of a camera, intrinsics aside
int point_storage(CameraModelId model);   // numbers stored for a point; 4: homogeneous

// camera ← camera + delta, point ← point + delta, in the tangents of the model.
void plus_camera(CameraModelId model, const double* camera, const double* delta, double* result);
void plus_point(CameraModelId model, const double* point, const double* delta, double* result);

// Takes out what no image sees: the scale of homogeneous coordinates. Nothing for metric models.
void normalize_camera(CameraModelId model, double* camera);
void normalize_point(CameraModelId model, double* point);

}  // namespace sfmcpp

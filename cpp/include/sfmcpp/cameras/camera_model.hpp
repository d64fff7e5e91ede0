// The camera models by name, and what they have in common.
//
// A camera is a 3×4 row-major block of 12 numbers. For metric cameras it is [R | c]: rotation
// world_from_camera and centre in the world (EQUATIONS §1, the note's parametrisation). A row of
// intrinsic parameters belongs to one camera or is shared by several.
//
// How to add a camera model: write a struct like those beside this file (constants, `project`, and
// `linearize` for any number type), add an enumerator and its names here, and one line in
// residuals/reprojection_kernels.cpp. The law suite in tests/cpp/cameras runs over every model.
#pragma once

#include <array>
#include <span>
#include <string_view>
#include <utility>

#include "sfmcpp/core/enum_names.hpp"

namespace sfmcpp {

enum class CameraModelId { kCalibrated, kPerspective, kBal };

template <>
struct EnumNames<CameraModelId> {
  static constexpr std::string_view kWhat = "camera_model";
  static constexpr std::array<std::pair<CameraModelId, std::string_view>, 3> kTable{
      {{CameraModelId::kCalibrated, "calibrated"},
       {CameraModelId::kPerspective, "perspective"},
       {CameraModelId::kBal, "bal"}}};
};

inline constexpr int kCameraStorage = 12;  // numbers stored for a camera
inline constexpr int kPoseTangent = 6;     // rotation, then centre

// Names of the intrinsic parameters, in the order they are stored.
std::span<const std::string_view> intrinsic_names(CameraModelId model);

// Whether any intrinsic parameter of the model may be free.
bool has_free_intrinsics(CameraModelId model);

// R ← R · exp([δR]×), c ← c + δc, with delta = (δR, δc) (note §2).
void plus_pose(const double* camera, const double* delta, double* result);

}  // namespace sfmcpp

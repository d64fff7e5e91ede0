// The pose of a metric camera: [R | c], row-major 3×4, rotation world_from_camera and centre.
#pragma once

namespace sfmcpp {

inline constexpr int kPoseTangent = 6;  // rotation, then centre

// R ← R · exp([δR]×), c ← c + δc, with delta = (δR, δc) (note §2).
void plus_pose(const double* camera, const double* delta, double* result);

}  // namespace sfmcpp

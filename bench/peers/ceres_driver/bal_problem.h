// A BAL problem as read from its file: nine parameters a camera (angle-axis, translation, f, k1,
// k2), three a point.
#pragma once

#include <array>
#include <string>
#include <vector>

struct Observation {
  int camera;
  int point;
  double u_px;
  double v_px;
};

struct BalProblem {
  std::vector<Observation> observations;
  std::vector<std::array<double, 9>> cameras;
  std::vector<std::array<double, 3>> points;
};

// Throws std::runtime_error naming the file and what is missing in it.
BalProblem ReadBal(const std::string& path);

// Cameras, then points, as raw little-endian doubles.
void WriteState(const BalProblem& problem, const std::string& path);

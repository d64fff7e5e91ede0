// Which part of a dense matrix over all unknowns a block-diagonal one keeps, and the scenes to try
// it on.
#pragma once

#include <ostream>
#include <random>

#include "support/dense_reference.hpp"

namespace sfmcpp::support {

// A number for each column: equal within a variable block of the cameras and within a point.
inline std::vector<int> block_numbers(const LinearizedProblem& linearized,
                                      const DenseSystem& dense) {
  std::vector<int> numbers(static_cast<std::size_t>(dense.jacobian.cols()));
  for (int k = 0; k < dense.camera_columns; ++k) numbers[k] = linearized.map.block_of[k];
  for (int k = dense.camera_columns; k < dense.jacobian.cols(); ++k) {
    numbers[k] = linearized.map.num_blocks() + (k - dense.camera_columns) / 3;
  }
  return numbers;
}

// `matrix` over the first columns of the dense system, with zeros outside the diagonal blocks.
inline Eigen::MatrixXd block_diagonal(const LinearizedProblem& linearized,
                                      const DenseSystem& dense,
                                      const Eigen::MatrixXd& matrix) {
  const std::vector<int> numbers = block_numbers(linearized, dense);
  Eigen::MatrixXd blocks = matrix;
  for (Eigen::Index c = 0; c < matrix.cols(); ++c) {
    for (Eigen::Index r = 0; r < matrix.rows(); ++r) {
      if (numbers[r] != numbers[c]) blocks(r, c) = 0.0;
    }
  }
  return blocks;
}

// JᵀJ + λD.
inline Eigen::MatrixXd damped_matrix(const DenseSystem& dense, const linear::Damping& damping) {
  Eigen::MatrixXd matrix = dense.jacobian.transpose() * dense.jacobian;
  matrix.diagonal() += damping_diagonal(dense, damping);
  return matrix;
}

inline linear::Step random_step(const LinearizedProblem& linearized, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  linear::Step step;
  for (int k = 0; k < linearized.map.num_columns; ++k) step.camera.push_back(normal(random));
  for (int p = 0; p < linearized.graph.num_points; ++p) {
    for (int k = 0; k < 3; ++k) {
      step.point.push_back(linearized.map.free_point[p] ? normal(random) : 0.0);
    }
  }
  return step;
}

struct BlockScene {
  const char* name;
  CameraModelId model;
  int groups = 0;  // of shared intrinsics
  bool some_fixed = false;
};
inline void PrintTo(const BlockScene& scene, std::ostream* out) { *out << scene.name; }

inline const std::vector<BlockScene> kBlockScenes{
    {"Calibrated", CameraModelId::kCalibrated},
    {"CalibratedSomeFixed", CameraModelId::kCalibrated, 0, true},
    {"Bal", CameraModelId::kBal},
    {"BalShared", CameraModelId::kBal, 2},
    {"PerspectiveOneForAllSomeFixed", CameraModelId::kPerspective, 1, true}};

inline OwnedProblem make_block_scene(const BlockScene& scene) {
  SceneOptions options = perturbed(scene.model);
  options.num_groups = scene.groups;
  options.num_points = 30;
  options.window = 4;
  options.varied_sigma = true;
  OwnedProblem problem = make_circle_scene(options);
  if (scene.some_fixed) {
    problem.fixed_cameras[2] = problem.fixed_points[0] = problem.fixed_points[17] = 1;
  }
  return problem;
}

}  // namespace sfmcpp::support

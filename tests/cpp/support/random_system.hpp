// A linear least-squares problem of the shape of bundle adjustment, with random coefficients: the
// normal equations, and the same as a dense matrix.
#pragma once

#include <functional>
#include <ostream>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "sfmcpp/linear/linear_solver.hpp"
#include "support/dense_system.hpp"

namespace sfmcpp::support {

struct SystemOptions {
  std::string name{};  // of a test
  int cameras = 6;
  int points = 30;
  int camera_size = 6;  // one that kernels are compiled for
  int padding = 0;      // last columns of each camera that are none
  int shared = 0;       // columns before these that are shared by a group of cameras …
  int groups = 0;       // … of which there are so many, in turn; 0: each has its own
  int window = 0;       // cameras in turn that see a point; 0: all
  std::vector<int> fixed_cameras{}, fixed_points{};
  std::vector<std::pair<int, int>> fixed_columns{};   // (camera, column of its block), as a gauge
  std::vector<int> blind_columns{};                   // that no residual depends on
  std::function<bool(int camera, int point)> sees{};  // instead of the window
  linear::CameraPairs pairs{};  // that residuals relate; equal: of one camera alone
  bool dense = true;            // whether the dense Jacobian is made
  linear::Precision stored = linear::Precision::kDouble;  // single: coefficients are rounded too
  bool compensated = false;  // whether the gradient has the same bits for any number of ranks
  int threads = 1;
  unsigned seed = 1;
};
inline void PrintTo(const SystemOptions& options, std::ostream* out) { *out << options.name; }

// The points of one rank out of several are those whose number leaves its rank as remainder.
linear::ObservationGraph make_graph(const SystemOptions& options, int rank = 0, int num_ranks = 1);
linear::ParameterMap make_map(const SystemOptions& options, int rank = 0, int num_ranks = 1);

class RandomSystem {
 public:
  explicit RandomSystem(const SystemOptions& options, Exchange& exchange = this_process());

  linear::LinearSolveResult solve(const linear::LinearSolverOptions& solver,
                                  const linear::Damping& damping,
                                  linear::Step& step) const;
  const linear::NormalEquations& normal() const { return normal_; }
  linear::CameraModes& camera_modes() { return normal_.camera_modes(); }
  void hold_intrinsics(bool held) { normal_.hold_intrinsics(held); }
  // Of all ranks.
  const DenseSystem& dense() const { return dense_; }
  double cost() const { return 0.5 * dense_.residual.squaredNorm(); }

  // What accepting the step does: the residual of the new place, with the same Jacobian.
  void move(const linear::Step& step);

  linear::ObservationGraph graph;
  linear::ParameterMap map;

 private:
  using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  struct Block {
    int camera = 0;
    int point = -1;  // −1: a residual of cameras alone
    int other = linear::kNoCamera;
    int row = 0;  // of the dense system
    Matrix by_camera{},
        by_other{};  // by a camera block, and by that of the other camera or by the point
  };

  void add_observations(const SystemOptions& options);
  void add_pairs(const SystemOptions& options);
  Matrix random_matrix(int rows, int columns);
  Matrix random_camera_matrix(int rows, const SystemOptions& options);
  void round_coefficients();
  void make_dense(const SystemOptions& options);
  void fill();
  void fill(const Block& block, double* jacobian, linear::PointRecord& record) const;

  ThreadPool pool_;
  Exchange& exchange_;
  linear::NormalEquations normal_;
  std::mt19937 random_;
  std::vector<Block> blocks_;
  DenseSystem dense_;
};

// What most tests of linear algebra are on.
std::vector<SystemOptions> random_systems();

}  // namespace sfmcpp::support

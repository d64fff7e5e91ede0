// What a linear model keeps to itself: the workspace of a solve, and views of its blocks.
#pragma once

#include <algorithm>
#include <memory>

#include "sfmcpp/ba/linear_model.hpp"
#include "sfmcpp/linear/explicit_schur.hpp"
#include "workspace.hpp"

namespace sfmcpp::ba {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using linear::kNoColumn;

using RowsByCamera = Eigen::Matrix<double, 2, Eigen::Dynamic, Eigen::RowMajor>;
using RowsByPoint = Eigen::Matrix<double, 2, 3, Eigen::RowMajor>;
using PointView = Eigen::Map<const RowsByPoint, 0, Eigen::OuterStride<4>>;

// Rows of a camera block that have a column: (row, column).
template <class F>
void for_each_column(const linear::ParameterMap& map, int camera, const F& f) {
  const int* columns = map.columns_of(camera);
  for (int k = 0; k < map.camera_size; ++k) {
    if (columns[k] != kNoColumn) f(k, columns[k]);
  }
}

struct LinearModel::Work {
  Work(const Problem& problem, const SolveOptions& options, const optim::State& state)
      : space(problem, options, state) {}

  const linear::NormalEquations& normal() const { return space.model.normal_equations(); }
  // Of images, and of rows on points (point_rows.hpp).
  const linear::ObservationGraph& graph() const { return space.rows.graph(); }
  int size() const { return space.map.camera_size; }

  // Derivatives of the projection, times √ρ′: J of the residuals with its sign turned.
  Eigen::Map<const RowsByCamera> by_camera(int a) const {
    return {normal().camera_jacobian(a), 2, size()};
  }
  PointView by_point(int a) const { return PointView(normal().point_record(a).row[0].by_point); }
  // V⁻¹; zero in what no observation of the point determines.
  Matrix3d point_inverse(int p) const {
    const linear::PointFactor& m = solver->elimination().factor(p);
    Matrix3d factor;
    factor << m.m00, 0.0, 0.0, m.m10, m.m11, 0.0, m.m20, m.m21, m.m22;
    return factor.transpose() * factor;
  }
  int point_rank(int p) const {
    const linear::PointFactor& m = solver->elimination().factor(p);
    const int rank = (m.m00 > 0.0) + (m.m11 > 0.0) + (m.m22 > 0.0);
    return std::min(rank, 2 * graph().observations_of_point(p));
  }
  // f(a) for the stored observations of a point.
  template <class F>
  void for_each_view(int p, const F& f) const {
    for (int k = graph().point_begin[p]; k < graph().point_begin[p + 1]; ++k)
      f(graph().of_point[k]);
  }

  Workspace space;
  std::unique_ptr<linear::ExplicitSchurSolver> solver;
};

}  // namespace sfmcpp::ba

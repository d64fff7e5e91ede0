// The linear model of a problem at one state, and what statistics ask of it.
//
// Residuals r = (observed − projected)/σ of the observations, errors √(member weight · ρ′) e of
// groups of constraints with weights w, ρ the loss of the group:
//   √ρ′ r(x ⊕ δ) ≈ √ρ′ r + J δ,   e(x ⊕ δ) ≈ e + G δ,   H = JᵀJ + Σ w GᵀG,
// with J, H and the factorised Schur complement S of the solver itself. Nothing is derived twice.
//
// Columns: the reduced ones of cameras and intrinsics (parameter_map.hpp), then three for each
// point that may move. In the free gauge they are all columns, H is singular, and the inverse that
// the datum chooses is meant: with H⁻ the inverse where the columns of choose_gauge() are held, W
// weights of the columns and N a basis of what H does not see with NᵀWN = I,
// (I − NNᵀW) H⁻ (I − WNNᵀ), the covariance of the solution with the least δᵀWδ (Baarda's S-
// transformation; Teunissen 1985). In the fixed gauge held columns are left out and the inverse is
// meant.
#pragma once

#include <memory>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>
#include <Eigen/SparseCore>

#include "sfmcpp/ba/problem.hpp"
#include "sfmcpp/ba/solve_options.hpp"
#include "sfmcpp/core/eigen_allocator.hpp"
#include "sfmcpp/core/enum_names.hpp"
#include "sfmcpp/math/decompositions.hpp"
#include "sfmcpp/optim/state.hpp"
#include "sfmcpp/residuals/constraint_set.hpp"

namespace sfmcpp::ba {

class WorldMotions;

// What covariances of a free network refer to: the columns that have a weight.
enum class Datum { kCameras, kAll };

}  // namespace sfmcpp::ba

namespace sfmcpp {

template <>
struct EnumTraits<ba::Datum> {
  static constexpr std::string_view kWhat = "datum";
  static constexpr auto kTable = std::to_array<EnumRow<ba::Datum>>(
      {{ba::Datum::kCameras,
        "cameras",
        "poses alone, rotations in radians and centres over their extent"},
       {ba::Datum::kAll, "all", "all columns, as they are: the pseudo-inverse"}});
};

}  // namespace sfmcpp

namespace sfmcpp::ba {

// A group's errors and their derivatives, without the weight of the group; members of weight zero
// have no rows.
struct ConstraintRows {
  std::string name;
  double weight = 0.0;
  std::vector<int> member;  // of each row
  Eigen::VectorXd errors;
  Eigen::SparseMatrix<double, Eigen::RowMajor> jacobian;  // rows × camera columns, or all
};

// The minimum of the linear model.
struct LinearStep {
  optim::State state;                   // moved there
  std::vector<Eigen::VectorXd> errors;  // of each group, as the model predicts them
  double decrease = 0.0;                // of the cost, likewise
};

// What is asked for is computed when it first is, and kept: not for several threads at once.
class LinearModel {
 public:
  // The largest reduced system that is inverted as a whole.
  static constexpr int kMaxInverse = 4000;

  // Linearises at a state, such as solve() ends with, or at the start that the problem holds; the
  // arrays of the problem are not read later. `ridge` is added to the diagonal of H as a share of
  // it. Throws InvalidArgument as solve() does.
  LinearModel(const Problem& problem,
              const SolveOptions& options,
              const optim::State& state,
              double ridge = 0.0,
              Datum datum = Datum::kCameras);
  LinearModel(const Problem& problem,
              const SolveOptions& options,
              double ridge = 0.0,
              Datum datum = Datum::kCameras);
  ~LinearModel();
  LinearModel(const LinearModel&) = delete;
  LinearModel& operator=(const LinearModel&) = delete;

  int num_cameras() const;
  int num_points() const;
  int num_observations() const;
  // Columns of a camera: its pose, then the intrinsic parameters that are free in any row, then the
  // pose of its sensor if one is free.
  int camera_size() const;
  bool has_free_sensors() const { return problem_.rigs.any_free(); }
  std::vector<std::string> free_intrinsics() const;
  int num_camera_columns() const { return map_.num_columns; }
  int num_columns() const { return map_.num_columns + 3 * static_cast<int>(points_.size()); }
  void camera_columns(int* out) const;  // cameras × camera_size, −1: none
  void point_columns(int* out) const;   // the first of three of each point, −1: none

  double cost() const { return cost_; }
  double loss_scale() const;
  // In the caller's order, two per observation; ρ′, one per observation.
  void residuals(double* out) const;
  void observation_weights(double* out) const;
  // J in blocks, observations in the caller's order: 2 × camera_size and 2 × 3.
  void jacobian(double* by_camera, double* by_point) const;
  const std::vector<ConstraintRows>& groups() const { return groups_; }

  // All that follows needs S factorised; the first call does so. Throws InvalidArgument for a
  // projective camera model, whose gauge no column can hold, and where H is singular beyond the
  // gauge, by sensors of rigs or otherwise.

  // Parameters that residuals and constraints determine: the rank of H.
  int num_determined();
  double log_determinant();  // of S, in the fixed gauge
  // Covariance among chosen columns.
  Eigen::MatrixXd covariance(std::span<const int> columns);
  // Of blocks of columns, `width` each with −1 for none, each block by itself: blocks × width ×
  // width.
  void covariance_blocks(std::span<const int> columns, int width, double* out);
  // J_o H⁻¹ J_oᵀ of each observation in the caller's order, 2 × 2.
  void leverages(double* out);
  // w G H⁻¹ Gᵀ of a group: how much its errors draw the fit to themselves.
  const Eigen::MatrixXd& hat(int group);
  Spectrum hat_spectrum(int group);
  LinearStep step();

 private:
  using SparseColumns = Eigen::SparseMatrix<double>;
  using Entry = Eigen::Triplet<double>;
  struct Work;

  void name_columns();
  void fill_groups();
  void add_entries_of_point(int point,
                            const double* jacobian,
                            int row,
                            std::vector<Entry>& out) const;
  void factorize();
  void require_sensors();
  void find_unseen();
  Eigen::VectorXd datum_roots(const Eigen::MatrixXd& motions) const;
  Eigen::MatrixXd motions() const;
  void add_camera(const WorldMotions& world, int camera, Eigen::MatrixXd& motions) const;
  Eigen::MatrixXd assembled(const Eigen::MatrixXd& camera, const Eigen::MatrixXd& point) const;
  void require_determined(std::span<const int> columns, const Eigen::MatrixXd& covariance) const;
  const Eigen::MatrixXd& inverse();
  SparseColumns reduced(std::span<const int> columns) const;
  Eigen::MatrixXd solve(const SparseColumns& rhs) const;
  void add_points(std::span<const int> columns, Eigen::MatrixXd& covariance) const;
  Eigen::MatrixXd in_the_gauge(std::span<const int> columns, Eigen::MatrixXd covariance) const;
  Eigen::MatrixXd hat_with_points(const ConstraintRows& group);
  Eigen::MatrixXd hat_of_cameras(const ConstraintRows& group);
  void solve_all(Eigen::MatrixXd& camera, Eigen::MatrixXd& point);

  double ridge_;
  Datum datum_;
  residuals::ConstraintSet constraints_;
  Problem problem_;
  optim::State state_;
  std::unique_ptr<Work> work_;    // in the fixed gauge
  linear::ParameterMap map_;      // what columns are called outside
  std::vector<int> points_;       // that may move
  std::vector<int> point_place_;  // among them, −1: fixed or not seen
  std::vector<int> held_;         // columns that the fixed gauge holds
  std::vector<int> inner_;        // column of each outer one in the fixed gauge, −1: held
  double cost_ = 0.0;
  std::vector<double> residuals_;  // in stored order
  std::vector<ConstraintRows> groups_;
  std::vector<Eigen::MatrixXd> hats_;   // of each group, once asked for
  linear::Step step_;                   // to the minimum, in the fixed gauge
  Eigen::MatrixXd inverse_;             // S⁻¹, once needed
  Eigen::MatrixXd unseen_, of_unseen_;  // N and H⁻WN, rows by columns
  Eigen::MatrixXd among_unseen_;        // NᵀWH⁻WN
};

}  // namespace sfmcpp::ba

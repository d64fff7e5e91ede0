// Constraints on cameras in named groups, one weight each, which a bundle adjustment minimises
// together with the errors of its observations (thesis ch. 5, docs/equations.md §7).
//
// The cost of a group is ½ weight Σ member weight · ‖e‖², e of constraint_kinds.hpp: a weighted sum
// of MEAN squared errors. A group that measures with standard deviation σ, in the unit of e, has
// the weight d/σ² with d the dimension of e, where observations are over theirs; a constraint
// chosen by λ beside N observations has the member weight λ² N (docs/equations.md §6).
//
// A group may have a robust loss, with the cost ½ Σ ρ(s), s = weight · member weight · ‖e‖²: the
// squared error over σ² where the weight is d/σ², so that the loss has its scale in σ.
//
// The weight of a member may be one for each entry of e: a receiver that knows its height less well
// than its place. A group may have a function from outside in place of the equation of a kind: of
// poses, of a pose and a point, or of points alone.
//
// Changing a weight rebuilds nothing.
#pragma once

#include <array>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "sfmcpp/cameras/camera_model.hpp"
#include "sfmcpp/residuals/loss.hpp"
#include "sfmcpp/residuals/pose_constraints.hpp"

namespace sfmcpp::residuals {

inline constexpr int kNoPrevious = -1;
inline constexpr int kNoCamera = -1;
inline constexpr int kNoPoint = -1;

// `previous` is for kinds that relate two poses, and for intrinsics that are compared with those of
// another camera rather than with measured ones.
struct ConstraintMember {
  int camera = 0;  // or none, where a function is of points alone
  int previous = kNoPrevious;
  int point = kNoPoint;  // of a function
  double weight = 1.0;
  std::vector<double> entry_weights{};         // beside `weight`, of each entry of e; empty: 1
  PoseConstraint pose{};                       // its kind and points are the set's to fill in
  std::array<double, 2> intrinsics{1.0, 0.0};  // f̂, or ĉx and ĉy [px]
  std::vector<double> points{};                // N × 3, of kinds that compare images
};

// Residuals of poses and points by a function from outside, of all members of a group in one call.
class ResidualFunction {
 public:
  // Where they go, members × rows, and their Jacobians, members × rows × poses × 6 and members ×
  // rows × 3: null where they are not asked for, or there are none. All numbers are NaN before.
  struct Output {
    double* residuals;
    double* by_poses;
    double* by_points;
  };

  virtual ~ResidualFunction() = default;
  virtual int rows() const = 0;  // of each member
  // `poses`: of each member the previous one, if it has one, and this, 12 numbers each. `points`:
  // three numbers of each, of members that have one.
  virtual void evaluate(const double* poses, const double* points, const Output& out) const = 0;
};

struct ConstraintGroup {
  std::string name;
  ConstraintKind kind = ConstraintKind::kPosition;
  double weight = 1.0;
  std::vector<ConstraintMember> members{};
  Loss loss{};  // of each member
  // In place of the equation of the kind: e is what it gives, with no mean taken. All members then
  // have a previous camera, or none has; likewise a point, and, if they have one, a camera.
  std::shared_ptr<const ResidualFunction> function{};
};

// The cameras that the constraints are on, and the points that functions are on, as ba/problem.hpp
// and optim/state.hpp have them.
struct ConstrainedCameras {
  CameraModel camera_model = CameraModelId::kCalibrated;
  int count = 0;
  const double* cameras = nullptr;
  const double* intrinsics = nullptr;
  const int* intrinsics_index = nullptr;
  int num_points = 0;
  const double* points = nullptr;

  const double* pose(int i) const { return cameras + static_cast<long>(kCameraStorage) * i; }
  const double* intrinsics_of(int i) const;
};

// Where the derivatives of a constraint go among the D columns of a camera: rotation 0–2, centre
// 3–5, and the columns of the intrinsic parameters.
struct ConstraintColumns {
  static constexpr int kNone = -1;
  int width = 6;                   // D
  std::vector<int> of_intrinsics;  // column of each intrinsic parameter; kNone: not free
};

// √(group weight · member weight) e, and its Jacobians, rows × D and rows × 3 row-major; none of
// what a member does not have. Kept between calls: memory grows to the largest member.
struct ConstraintResidual {
  int rows = 0;
  std::vector<double> residual{}, by_camera{}, by_previous{}, by_point{};

  std::array<std::vector<double>*, 4> all() {
    return {&residual, &by_camera, &by_previous, &by_point};
  }
};

class ConstraintSet {
 public:
  // Throws InvalidArgument naming group, member, value and rule: a name that is empty or taken, a
  // weight that is negative or not finite, a scale of a loss that is not positive, a measurement
  // that cannot be one, cameras that do not go with the kind.
  void add(ConstraintGroup group);
  void set_weight(std::string_view name, double weight);

  const std::vector<ConstraintGroup>& groups() const { return groups_; }
  bool empty() const { return groups_.empty(); }

  // Throws InvalidArgument for constraints that these cameras cannot have: an index out of range, a
  // camera model that is not metric or lacks the parameter, frozen points behind a camera.
  void check(const ConstrainedCameras& cameras) const;

  // The cost of each group, and of all.
  std::vector<double> costs(const ConstrainedCameras& cameras) const;
  double cost(const ConstrainedCameras& cameras) const;

 private:
  std::vector<ConstraintGroup> groups_;
};

// Whether a member takes part: its weight and that of its group are positive.
bool is_active(const ConstraintGroup& group, const ConstraintMember& member);

// "constraints['gps'][3]", for messages.
std::string name_of(const ConstraintGroup& group, std::size_t member);

// Intrinsic parameters that a kind is on, in the order of the model; none where it has no such
// parameter or the kind is on poses.
std::vector<int> constrained_intrinsics(ConstraintKind kind, const CameraModel& model);

// What the member measured, ready to be evaluated or validated; views its points.
PoseConstraint measurement_of(const ConstraintMember& member);

// Rank of the Jacobian, where the constraint is fulfilled.
int num_equations(const ConstraintGroup& group, const ConstraintMember& member);

// Whether it is on poses, or points; else on intrinsics.
bool is_on_poses(const ConstraintGroup& group);
bool is_on_points(const ConstraintGroup& group);

// ‖e‖² of what evaluate() gives: with all weights.
double squared_error(const ConstraintResidual& e);

// Residual and Jacobians times √ρ′(‖e‖²), as robust observations are: the gradient is that of the
// robust cost, the Hessian its positive part.
void apply_loss(const Loss& loss, ConstraintResidual& e);

// One member of a group without a function. Without Jacobians if `columns` is null. Weights as in
// ConstraintResidual.
void evaluate(const ConstraintGroup& group,
              const ConstraintMember& member,
              const ConstrainedCameras& cameras,
              const ConstraintColumns* columns,
              ConstraintResidual& out);

// Calls visit(k, e) with the position and the residual of each active member, in their order; e may
// be changed.
using ResidualVisitor = std::function<void(std::size_t, ConstraintResidual&)>;
void evaluate_all(const ConstraintGroup& group,
                  const ConstrainedCameras& cameras,
                  const ConstraintColumns* columns,
                  const ResidualVisitor& visit);

}  // namespace sfmcpp::residuals

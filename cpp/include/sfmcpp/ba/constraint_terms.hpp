// The constraints of a problem as part of its cost and of its normal equations
// (residuals/constraint_set.hpp, linear/camera_terms.hpp, and ba/point_rows.hpp). The robust loss
// of the observations does not apply to them: a group may have its own.
#pragma once

#include <functional>
#include <vector>

#include "sfmcpp/ba/point_rows.hpp"
#include "sfmcpp/ba/problem.hpp"
#include "sfmcpp/ba/rigs.hpp"
#include "sfmcpp/linear/camera_terms.hpp"
#include "sfmcpp/residuals/constraint_set.hpp"

namespace sfmcpp::ba {

// The cameras and points of a state, as constraints see them.
residuals::ConstrainedCameras constrained_cameras(const Problem& problem,
                                                  const optim::State& state);

// Per point, whether anything ties it to a camera: an image, or a function of both.
std::vector<char> points_tied_to_cameras(const Problem& problem,
                                         const linear::ObservationGraph& images);

// Throws InvalidArgument, naming group and member, for constraints that break a rule at this state,
// or that are on intrinsics which are all fixed.
void check_constraints(const Problem& problem, const optim::State& state);

class ConstraintTerms {
 public:
  // The references must outlive this object. A member whose weight is zero here takes no part in
  // the normal equations: the problem is the one without it.
  ConstraintTerms(const Problem& problem,
                  const linear::ParameterMap& map,
                  const std::vector<int>& free_intrinsics);

  // Cameras that members without points relate.
  linear::CameraPairs pairs() const;
  // Calls visit(member's position, e) for each active member of a group: e with derivatives in the
  // columns of cameras.
  void for_each_active(
      const residuals::ConstraintGroup& group,
      const optim::State& state,
      const std::function<void(std::size_t, residuals::ConstraintResidual&)>& visit) const;
  // Independent equations at most.
  long num_equations() const;

  double cost(const optim::State& state) const;
  // Of each group.
  std::vector<double> costs(const optim::State& state) const;
  // Fills the terms and rows of the normal equations at `state`.
  void linearize(const optim::State& state, PointRows& rows, linear::NormalEquations& normal) const;
  // Derivative of the cost along a step, at `state`.
  double slope(const optim::State& state, const linear::Step& step) const;

 private:
  struct Active {
    const residuals::ConstraintGroup* group;
    const residuals::ConstraintMember* member;
  };

  // Those that were active at the start must be so still: weights stay during a solve.
  void for_each_weighted(const optim::State& state,
                         const std::function<void(const residuals::ConstraintGroup&,
                                                  std::size_t,
                                                  residuals::ConstraintResidual&)>& visit) const;

  const Problem& problem_;
  const linear::ParameterMap& map_;
  Frames frames_;
  residuals::ConstraintColumns columns_;
  std::vector<Active> active_;
};

}  // namespace sfmcpp::ba

// Residuals on points by functions, as linear solvers have them: two rows at a time, as one
// observation of the point by a twin of the camera.
//
// A twin has the columns of its camera, as the cameras of a frame share theirs; the twin of no
// camera has none. So all solvers take them as they are. S is gathered by pairs of cameras, which
// see a point once: where a camera has more rows on a point, it has more twins.
#pragma once

#include <span>
#include <vector>

#include "sfmcpp/ba/problem.hpp"
#include "sfmcpp/linear/normal_equations.hpp"
#include "sfmcpp/residuals/constraint_set.hpp"

namespace sfmcpp::ba {

class PointRows {
 public:
  // The references must outlive this object. Of members whose weight is not zero. Throws
  // InvalidArgument on several ranks, if there are any.
  PointRows(const Problem& problem,
            const linear::ObservationGraph& images,
            Exchange& exchange = this_process());

  bool empty() const { return members_.empty(); }
  // The observations of the images in their order, and the same chunks; then those of the twins.
  const linear::ObservationGraph& graph() const { return empty() ? images_ : graph_; }
  // Per point, whether there are rows on it; empty: on none.
  std::span<const char> points() const { return is_on_; }
  // Adds the columns of the twins, and frees the points that rows are on.
  void add_to(linear::ParameterMap& map) const;

  // A linearisation: first this; then each member, e as r of the normal equations has its sign, its
  // derivatives in the columns of its camera …
  void start(int camera_size);
  void set(const residuals::ConstraintGroup& group,
           std::size_t member,
           const residuals::ConstraintResidual& e);
  // … and gives all of them away.
  void fill(linear::NormalEquations& normal) const;

 private:
  struct Member {
    const residuals::ConstraintGroup* group;
    std::size_t position;
    std::size_t first;  // of its pairs of rows

    int camera() const { return group->members[position].camera; }
    int point() const { return group->members[position].point; }
    int pairs() const { return (group->function->rows() + 1) / 2; }
  };

  void find_members();
  void make_graph();

  const Problem& problem_;
  const linear::ObservationGraph& images_;
  linear::ObservationGraph graph_;
  std::vector<Member> members_;   // by group and position
  std::vector<char> is_on_;       // per point
  std::vector<int> twins_;        // the camera of each twin, or none
  std::vector<int> place_;        // of each pair of rows, among those of all twins
  std::vector<double> jacobian_;  // of the twins, as in the normal equations
  std::vector<linear::PointRecord> records_;
};

}  // namespace sfmcpp::ba

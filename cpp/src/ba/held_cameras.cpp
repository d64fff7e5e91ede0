#include "sfmcpp/ba/held_cameras.hpp"

#include <algorithm>
#include <cmath>
#include <string>

#include "sfmcpp/ba/constraint_terms.hpp"
#include "sfmcpp/ba/rigs.hpp"
#include "sfmcpp/cameras/pose.hpp"
#include "sfmcpp/core/error.hpp"
#include "sfmcpp/core/grouping.hpp"

namespace sfmcpp::ba {
namespace {

using residuals::ConstraintGroup;
using residuals::ConstraintMember;
using residuals::kNoPrevious;

// A pivot below this share of its column is rounding: the column follows from those before it.
constexpr double kNegligiblePivot = 1e-12;

// JᵀJ of poses, by rows from their first entry on: constraints in the order of time tie neighbours.
class Envelope {
 public:
  explicit Envelope(int poses) : row_(static_cast<std::size_t>(poses) * kPoseTangent) {}

  void add(const double* by_a, int a, const double* by_b, int b, int rows) {
    if (a < b) return add(by_b, b, by_a, a, rows);
    for (int r = 0; r < kPoseTangent; ++r) {
      const int i = kPoseTangent * a + r;
      reach(i, kPoseTangent * b);
      for (int c = 0; c < kPoseTangent && kPoseTangent * b + c <= i; ++c) {
        for (int e = 0; e < rows; ++e)
          at(i, kPoseTangent * b + c) += by_a[kPoseTangent * e + r] * by_b[kPoseTangent * e + c];
      }
    }
  }

  // Cholesky's factorisation of the matrix scaled to a diagonal of ones.
  bool has_full_rank() {
    const int count = static_cast<int>(row_.size());
    std::vector<double> scale(row_.size());
    for (int i = 0; i < count; ++i) {
      if (row_[i].empty() || !(at(i, i) > 0.0)) return false;
      scale[i] = 1.0 / std::sqrt(at(i, i));
    }
    for (int i = 0; i < count; ++i) {
      for (int j = first(i); j <= i; ++j) at(i, j) *= scale[i] * scale[j];
      for (int j = first(i); j < i; ++j) at(i, j) = (at(i, j) - dot(i, j)) / at(j, j);
      const double pivot = 1.0 - dot(i, i);
      if (pivot < kNegligiblePivot) return false;
      at(i, i) = std::sqrt(pivot);
    }
    return true;
  }

 private:
  int first(int i) const { return i + 1 - static_cast<int>(row_[i].size()); }
  double& at(int i, int j) { return row_[i][j - first(i)]; }
  void reach(int i, int j) {
    if (j < first(i)) row_[i].insert(row_[i].begin(), first(i) - j, 0.0);
  }
  // Of the parts of two rows before column j.
  double dot(int i, int j) {
    double sum = 0.0;
    for (int k = std::max(first(i), first(j)); k < j; ++k) sum += at(i, k) * at(j, k);
    return sum;
  }

  std::vector<std::vector<double>> row_;
};

// The Jacobian of a constraint on two cameras by the frame of both: where they cancel, no rounding
// is left.
void add_of_same_frame(const std::vector<double>& by_previous, std::vector<double>& by_camera) {
  constexpr double kRounding = 1e-12;
  double largest = 0.0;
  for (double value : by_previous) largest = std::max(largest, std::abs(value));
  for (std::size_t k = 0; k < by_camera.size(); ++k) {
    by_camera[k] += by_previous[k];
    if (std::abs(by_camera[k]) <= kRounding * largest) by_camera[k] = 0.0;
  }
}

// One constraint on a camera without images.
struct Tie {
  const ConstraintGroup* group;
  std::size_t position;

  const ConstraintMember& member() const { return group->members[position]; }
};

class HeldCameraSearch {
 public:
  HeldCameraSearch(const Problem& problem,
                   const linear::ObservationGraph& graph,
                   const optim::State& state)
      : problem_(problem),
        graph_(graph),
        state_(state),
        frames_(problem),
        cameras_(constrained_cameras(problem, state)),
        islands_(problem.num_cameras()),
        place_(problem.num_cameras()),
        held_(problem.num_cameras()) {
    columns_.width = kPoseTangent;
    columns_.of_intrinsics.assign(problem.num_intrinsics(), residuals::ConstraintColumns::kNone);
  }

  std::vector<std::uint8_t> run() {
    find_ties();
    if (ties_.empty()) return {};
    std::vector<std::vector<Tie>> ties(place_.size());
    for (const Tie& tie : ties_) {
      const int camera = frames_.lead(an_open_camera(tie.member()));
      ties[islands_.root(camera)].push_back(tie);
    }
    std::vector<std::vector<int>> members(place_.size());
    for (int i = 0; i < problem_.num_cameras(); ++i) {
      if (!frames_.leads(i)) continue;
      std::vector<int>& island = members[islands_.root(i)];
      place_[i] = static_cast<int>(island.size());
      island.push_back(i);
    }
    bool any = false;
    for (std::size_t i = 0; i < place_.size(); ++i) {
      if (ties[i].empty()) continue;
      const bool held = is_determined(ties[i], static_cast<int>(members[i].size()));
      if (!held) refuse_pairs(ties[i]);
      for (int camera : members[i]) held_[camera] = held;
      any |= held;
    }
    for (int i = 0; i < problem_.num_cameras(); ++i) held_[i] = held_[frames_.lead(i)];
    return any ? std::move(held_) : std::vector<std::uint8_t>();
  }

 private:
  // Without images and not fixed.
  bool is_open(int camera) const {
    return camera != kNoPrevious && !graph_.takes_part(camera) && !problem_.is_fixed_camera(camera);
  }
  int an_open_camera(const ConstraintMember& member) const {
    return is_open(member.camera) ? member.camera : member.previous;
  }

  void find_ties() {
    for (const ConstraintGroup& group : problem_.constraints->groups()) {
      for (std::size_t k = 0; k < group.members.size(); ++k) {
        const ConstraintMember& member = group.members[k];
        const bool here = is_open(member.camera), there = is_open(member.previous);
        if (!(here || there) || !residuals::is_active(group, member)) continue;
        ties_.push_back({&group, k});
        if (here && there)
          islands_.join(frames_.lead(member.previous), frames_.lead(member.camera));
      }
    }
  }

  // Errors count without their weights: these do not change what is determined.
  bool is_determined(const std::vector<Tie>& ties, int poses) {
    Envelope matrix(poses);
    for (const Tie& tie : ties) {
      if (tie.group->function || !residuals::is_on_poses(*tie.group)) continue;
      const ConstraintMember& member = tie.member();
      residuals::evaluate(*tie.group, member, cameras_, &columns_, error_);
      const double factor = 1.0 / std::sqrt(tie.group->weight * member.weight);
      for (double& value : error_.by_camera) value *= factor;
      for (double& value : error_.by_previous) value *= factor;
      carry(member.camera, error_.by_camera);
      if (member.previous != kNoPrevious) carry(member.previous, error_.by_previous);
      add(member, matrix);
    }
    return matrix.has_full_rank();
  }

  // From a camera to its frame.
  void carry(int camera, std::vector<double>& jacobian) const {
    if (frames_.any())
      frames_.motion(state_, camera).carry(jacobian.data(), error_.rows, kPoseTangent);
  }

  void add(const ConstraintMember& member, Envelope& matrix) {
    const bool here = is_open(member.camera), there = is_open(member.previous);
    const int at = here ? place_[frames_.lead(member.camera)] : 0;
    const int before = there ? place_[frames_.lead(member.previous)] : 0;
    const bool of_one_frame = here && there && at == before;
    if (of_one_frame) add_of_same_frame(error_.by_previous, error_.by_camera);
    const double *by_camera = error_.by_camera.data(), *by_previous = error_.by_previous.data();
    const int rows = error_.rows;
    if (of_one_frame) return matrix.add(by_camera, at, by_camera, at, rows);
    if (here) matrix.add(by_camera, at, by_camera, at, rows);
    if (there) matrix.add(by_previous, before, by_previous, before, rows);
    if (here && there) matrix.add(by_camera, at, by_previous, before, rows);
  }

  void refuse_pairs(const std::vector<Tie>& ties) const {
    for (const Tie& tie : ties) {
      if (tie.member().previous == kNoPrevious) continue;
      throw InvalidArgument(residuals::name_of(*tie.group, tie.position) + ".cameras: camera " +
                            std::to_string(an_open_camera(tie.member())) +
                            " has no observations, and constraints do not determine its pose "
                            "(functions do not count): must be observed, fixed or constrained "
                            "further");
    }
  }

  const Problem& problem_;
  const linear::ObservationGraph& graph_;
  const optim::State& state_;
  Frames frames_;
  residuals::ConstrainedCameras cameras_;
  residuals::ConstraintColumns columns_;
  residuals::ConstraintResidual error_;
  std::vector<Tie> ties_;
  DisjointSets islands_;    // frames that constraints tie, each its first camera
  std::vector<int> place_;  // of each frame in its island
  std::vector<std::uint8_t> held_;
};

}  // namespace

std::vector<std::uint8_t> cameras_held_by_constraints(const Problem& problem,
                                                      const linear::ObservationGraph& graph,
                                                      const optim::State& state) {
  if (problem.constraints == nullptr) return {};
  return HeldCameraSearch(problem, graph, state).run();
}

}  // namespace sfmcpp::ba

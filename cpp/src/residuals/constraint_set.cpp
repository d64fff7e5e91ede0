#include "sfmcpp/residuals/constraint_set.hpp"

#include <algorithm>
#include <numeric>

#include "constraint_set_checks.hpp"

namespace sfmcpp::residuals {
namespace {

template <class Kind>
const Kind* find_kind(std::string_view name) {
  for (const auto& entry : EnumNames<Kind>::kTable) {
    if (entry.second == name) return &entry.first;
  }
  return nullptr;
}

template <class Kind>
void append_names(std::vector<std::string_view>& names) {
  for (const auto& [kind, name] : EnumNames<Kind>::kTable) names.push_back(name);
}

// What the group says once and its members need to be evaluated.
void complete(ConstraintGroup& group) {
  const auto* kind = std::get_if<PoseConstraintKind>(&group.kind);
  for (ConstraintMember& member : group.members) {
    if (kind != nullptr) member.pose.kind = *kind;
    member.pose.points = {};
  }
}

double group_cost(const ConstraintGroup& group,
                  const ConstrainedCameras& cameras,
                  ConstraintResidual& scratch) {
  double sum = 0.0;
  for (const ConstraintMember& member : group.members) {
    if (!is_active(group, member)) continue;
    evaluate(group, member, cameras, nullptr, scratch);
    for (int row = 0; row < scratch.rows; ++row)
      sum += scratch.residual[row] * scratch.residual[row];
  }
  return 0.5 * sum;
}

}  // namespace

std::string_view constraint_kind_name(ConstraintKind kind) {
  return std::visit([](auto k) { return enum_name(k); }, kind);
}

std::vector<std::string_view> constraint_kind_names() {
  std::vector<std::string_view> names;
  append_names<PoseConstraintKind>(names);
  append_names<IntrinsicsConstraintKind>(names);
  return names;
}

ConstraintKind parse_constraint_kind(std::string_view name) {
  if (const auto* kind = find_kind<PoseConstraintKind>(name)) return *kind;
  if (const auto* kind = find_kind<IntrinsicsConstraintKind>(name)) return *kind;
  std::string known;
  for (std::string_view text : constraint_kind_names())
    known += (known.empty() ? "" : ", ") + std::string(text);
  throw InvalidArgument("kind = '" + std::string(name) + "': must be one of " + known);
}

void ConstraintSet::add(ConstraintGroup group) {
  for (const ConstraintGroup& other : groups_) {
    if (other.name == group.name)
      throw InvalidArgument("constraints['" + group.name + "']: two groups have this name");
  }
  complete(group);
  check_group(group);
  groups_.push_back(std::move(group));
}

void ConstraintSet::set_weight(std::string_view name, double weight) {
  const auto group = std::find_if(
      groups_.begin(), groups_.end(), [&](const ConstraintGroup& g) { return g.name == name; });
  if (group == groups_.end())
    throw InvalidArgument("constraints['" + std::string(name) + "']: no group has this name");
  check_weight("constraints['" + group->name + "'].weight", weight);
  group->weight = weight;
}

void ConstraintSet::check(const ConstrainedCameras& cameras) const {
  for (const ConstraintGroup& group : groups_) {
    for (std::size_t k = 0; k < group.members.size(); ++k) check_member(group, k, cameras);
  }
}

std::vector<double> ConstraintSet::costs(const ConstrainedCameras& cameras) const {
  ConstraintResidual scratch;
  std::vector<double> costs;
  costs.reserve(groups_.size());
  for (const ConstraintGroup& group : groups_) costs.push_back(group_cost(group, cameras, scratch));
  return costs;
}

double ConstraintSet::cost(const ConstrainedCameras& cameras) const {
  const std::vector<double> each = costs(cameras);
  return std::accumulate(each.begin(), each.end(), 0.0);
}

bool is_active(const ConstraintGroup& group, const ConstraintMember& member) {
  return group.weight > 0.0 && member.weight > 0.0;
}

std::string name_of(const ConstraintGroup& group, std::size_t member) {
  return "constraints['" + group.name + "'][" + std::to_string(member) + "]";
}

}  // namespace sfmcpp::residuals

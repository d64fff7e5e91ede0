#include <algorithm>
#include <array>
#include <limits>
#include <string>

#include <Eigen/Core>
#include <pybind11/stl.h>

#include "arguments.hpp"
#include "arrays.hpp"
#include "module.hpp"
#include "python_function.hpp"
#include "sfmcpp/cameras/matrix34.hpp"
#include "sfmcpp/cameras/pose.hpp"

namespace sfmcpp::bindings {
namespace {

using residuals::CamerasOfMember;
using residuals::ConstraintGroup;
using residuals::ConstraintKindFacts;
using residuals::ConstraintMember;
using residuals::kNoCamera;
using residuals::kNoPrevious;
using residuals::Measurement;

using RotationMatrix = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

// `function(poses, points, wanted)`, either or None, gives residuals (members, rows) and, where
// they are wanted, Jacobians (members, rows, poses, 6) and (members, rows, 3); Python has checked
// the shapes.
class PythonResiduals : public residuals::ResidualFunction, public PythonFunction {
 public:
  struct Shape {
    int members, poses, points, rows;
  };

  PythonResiduals(py::object function, const Shape& shape)
      : PythonFunction(std::move(function)), shape_(shape) {}

  int rows() const override { return shape_.rows; }

  void evaluate(const double* poses, const double* points, const Output& out) const override {
    const std::array<Answer, 3> answers{{{out.residuals, 1},
                                         {out.by_poses, long{shape_.poses} * kPoseTangent},
                                         {out.by_points, long{shape_.points} * kPointTangent}}};
    const long size = static_cast<long>(shape_.members) * shape_.rows;
    const auto arguments = [&] {
      return py::make_tuple(array_of({shape_.members, shape_.poses, 3, 4}, poses),
                            array_of({shape_.members, shape_.points * 3}, points),
                            out.by_poses != nullptr || out.by_points != nullptr);
    };
    const auto take = [&](const py::tuple& answer) {
      for (std::size_t k = 0; k < answers.size(); ++k) {
        if (answers[k].out != nullptr)
          copy_answer(answer[k], size * answers[k].width, answers[k].out);
      }
    };
    if (call(arguments, take)) return;
    for (const Answer& each : answers) {
      if (each.out != nullptr)
        std::fill_n(each.out, size * each.width, std::numeric_limits<double>::quiet_NaN());
    }
  }

 private:
  struct Answer {
    double* out;
    long width;  // of each row
  };

  static py::object array_of(const std::vector<py::ssize_t>& shape, const double* values) {
    if (shape[1] == 0) return py::none();
    return py::array_t<double>(shape, values);
  }

  Shape shape_;
};

void set_measurement(const ConstraintKindFacts& kind,
                     std::span<const double> values,
                     ConstraintMember& member) {
  if (!kind.is_on_poses()) {
    std::copy(values.begin(), values.end(), member.intrinsics.begin());
  } else if (kind.measurement == Measurement::kPose) {
    const PoseMatrixView pose(values.data());
    member.pose.rotation = pose.leftCols<3>();
    member.pose.translation = pose.col(3);
  } else if (kind.measurement == Measurement::kRotation) {
    member.pose.rotation = Eigen::Map<const RotationMatrix>(values.data());
  } else if (kind.measurement == Measurement::kVector) {
    member.pose.translation = Eigen::Map<const Eigen::Vector3d>(values.data());
  } else if (kind.measurement == Measurement::kScalar) {
    member.pose.distance = values[0];
  }
}

// Intrinsics that are compared with those of another camera are not measured.
int measured_numbers(const ConstraintKindFacts& kind, int previous) {
  const bool compared = !kind.is_on_poses() && previous != kNoPrevious;
  return compared ? 0 : size_of(kind.measurement);
}

void require_size(const ConstraintGroup& group,
                  const std::string& field,
                  std::size_t size,
                  std::size_t wanted,
                  std::size_t members) {
  if (size == wanted) return;
  throw InvalidArgument("constraints['" + group.name + "']." + field + ": " + std::to_string(size) +
                        " numbers, must be " + std::to_string(wanted) + " for " +
                        std::to_string(members) + " members");
}

void require_ranges(const ConstraintGroup& group,
                    std::span<const int> begin,
                    std::size_t points,
                    std::size_t members) {
  require_size(group, "points_begin", begin.size(), members + 1, members);
  if (begin.front() != 0 || !std::is_sorted(begin.begin(), begin.end()) ||
      static_cast<std::size_t>(begin.back()) * 3 != points) {
    throw InvalidArgument("constraints['" + group.name +
                          "'].points: must be one array (any, 3) for each member");
  }
}

// f, aspect, cx, cy, skew of a camera. One that is out of range is refused later.
std::array<double, 5> pinhole_of(const ba::Problem& problem, int camera) {
  constexpr std::array<std::string_view, 5> kNames{"f", "aspect", "cx", "cy", "skew"};
  std::array<double, 5> pinhole{1.0, 1.0, 0.0, 0.0, 0.0};
  if (camera < 0 || camera >= static_cast<int>(problem.intrinsics_index.size())) return pinhole;
  const int row = problem.intrinsics_index[camera];
  if (row < 0 || row >= problem.num_groups()) return pinhole;
  const auto names = intrinsic_names(problem.camera_model);
  for (std::size_t k = 0; k < names.size(); ++k) {
    const auto found = std::find(kNames.begin(), kNames.end(), names[k]);
    if (found != kNames.end())
      pinhole[found - kNames.begin()] = problem.intrinsics[names.size() * row + k];
  }
  return pinhole;
}

Loss loss_of(const py::dict& arrays, const std::string& group) {
  Loss loss;
  try {
    set_loss(arrays["loss"].cast<NamedLoss>(), loss.kind, loss.table);
  } catch (const InvalidArgument& error) {
    throw InvalidArgument("constraints['" + group + "']." + error.what());
  }
  const py::object scale = arrays["loss_scale"];
  loss.scale = scale.is_none() ? efficient_scale(loss, 1.0) : scale.cast<double>();
  return loss;
}

// One weight for each member, or one for each entry of each.
void set_weights(std::span<const double> weights, std::vector<ConstraintMember>& members) {
  const std::size_t size = members.empty() ? 1 : weights.size() / members.size();
  for (ConstraintMember& member : members) {
    const auto own = weights.first(size);
    member.weight = *std::ranges::max_element(own);
    if (size > 1) member.entry_weights.assign(own.begin(), own.end());
    for (double& weight : member.entry_weights) weight /= member.weight > 0.0 ? member.weight : 1.0;
    weights = weights.subspan(size);
  }
}

void fill_by_function(const py::dict& arrays, ConstraintGroup& group) {
  const auto cameras = view<const int>(arrays, "cameras");
  const auto weights = view<const double>(arrays, "member_weights");
  group.members.resize(cameras.size() / 2);
  for (std::size_t k = 0; k < group.members.size(); ++k) {
    group.members[k].previous = cameras[2 * k];
    group.members[k].camera = cameras[2 * k + 1];
  }
  require_size(group, "member_weights", weights.size(), group.members.size(), group.members.size());
  set_weights(weights, group.members);
  const auto points = view<const int>(arrays, "point_index");
  for (std::size_t k = 0; k < points.size(); ++k) group.members[k].point = points[k];
  const auto is_of = [&](int ConstraintMember::*part) {
    return !group.members.empty() && group.members[0].*part != kNoCamera;
  };
  group.function = std::make_shared<PythonResiduals>(
      arrays["function"],
      PythonResiduals::Shape{
          .members = static_cast<int>(group.members.size()),
          .poses = is_of(&ConstraintMember::camera) + is_of(&ConstraintMember::previous),
          .points = is_of(&ConstraintMember::point),
          .rows = arrays["rows"].cast<int>()});
}

void fill_by_kind(const py::dict& arrays, const ba::Problem& problem, ConstraintGroup& group) {
  group.kind = parse_enum<residuals::ConstraintKind>(arrays["kind"].cast<std::string>());
  const ConstraintKindFacts& kind = facts_of(group.kind);
  const auto cameras = view<const int>(arrays, "cameras");  // previous, this
  auto values = view<const double>(arrays, "values");
  const auto weights = view<const double>(arrays, "member_weights");
  const auto points = view<const double>(arrays, "points");
  const auto points_begin = view<const int>(arrays, "points_begin");
  const std::size_t count = cameras.size() / 2;
  std::size_t measured = 0;
  for (std::size_t k = 0; k < count; ++k) measured += measured_numbers(kind, cameras[2 * k]);
  require_size(group, "cameras", cameras.size(), 2 * count, count);
  require_size(group, "values", values.size(), measured, count);
  const bool of_members = weights.size() == count || kind.entries != kind.freedom;
  const std::size_t each = of_members ? 1 : static_cast<std::size_t>(kind.entries);
  require_size(group, "member_weights", weights.size(), each * count, count);
  require_ranges(group, points_begin, points.size(), count);
  for (std::size_t k = 0; k < count; ++k) {
    ConstraintMember member;
    member.previous = cameras[2 * k];
    member.camera = cameras[2 * k + 1];
    const std::size_t size = measured_numbers(kind, member.previous);
    if (size > 0) set_measurement(kind, values.first(size), member);
    values = values.subspan(size);
    member.pose.intrinsics = pinhole_of(problem, member.camera);
    member.points.assign(points.begin() + 3L * points_begin[k],
                         points.begin() + 3L * points_begin[k + 1]);
    group.members.push_back(std::move(member));
  }
  set_weights(weights, group.members);
}

ConstraintGroup group_of(const py::dict& arrays, const ba::Problem& problem) {
  ConstraintGroup group;
  group.name = arrays["name"].cast<std::string>();
  group.weight = arrays["weight"].cast<double>();
  group.loss = loss_of(arrays, group.name);
  if (arrays.contains("function")) {
    fill_by_function(arrays, group);
  } else {
    fill_by_kind(arrays, problem, group);
  }
  return group;
}

py::object shape_of(Measurement measurement) {
  static const std::vector<std::vector<int>> shapes{{}, {}, {2}, {3}, {3, 3}, {3, 4}};
  if (measurement == Measurement::kNone) return py::none();
  return py::tuple(py::cast(shapes[static_cast<std::size_t>(measurement)]));
}

py::tuple numbers_of(CamerasOfMember cameras) {
  if (cameras == CamerasOfMember::kOneOrTwo) return py::make_tuple(1, 2);
  return py::make_tuple(cameras == CamerasOfMember::kOne ? 1 : 2);
}

constexpr const char* kKindDoc = R"(What is known of a kind of constraint.

Attributes
----------
name : str
    Name of the kind.
values : tuple of int or None
    Shape of one measurement; None: the kind has none.
cameras : tuple of int
    How many cameras a member may name.
on_poses : bool
    Whether it is on poses; else on intrinsics.
compares_images : bool
    Whether it needs frozen points to compare the images of.
freedom : int
    Independent numbers in one measurement: nine entries of a rotation are three.
unit : str
    Unit of an error d of the sensor.
spread : float or None
    ``‖d‖² / ε`` to first order, ε the mean squared error; None: the number of its points.
error : str
    What is squared, before the division by its number of entries.
frame : str
    Frame of the measurement.
)";

}  // namespace

void bind_constraint_kinds(py::module_& m) {
  using F = ConstraintKindFacts;
  py::class_<F>(m, "ConstraintKind", kKindDoc)
      .def_property_readonly("name", [](const F& f) { return f.name; })
      .def_property_readonly(
          "values",
          [](const F& f) -> py::typing::Optional<py::tuple> { return shape_of(f.measurement); })
      .def_property_readonly("cameras", [](const F& f) { return numbers_of(f.cameras); })
      .def_property_readonly("on_poses", &F::is_on_poses)
      .def_property_readonly("compares_images", &F::compares_images)
      .def_readonly("freedom", &F::freedom)
      .def_property_readonly("unit", [](const F& f) { return f.unit; })
      .def_property_readonly(
          "spread",
          [](const F& f) { return f.compares_images() ? std::nullopt : std::optional(f.spread); })
      .def_property_readonly("error", [](const F& f) { return f.error; })
      .def_property_readonly("frame", [](const F& f) { return f.frame; })
      .def("__repr__", [](const F& f) { return "ConstraintKind('" + std::string(f.name) + "')"; })
      .def("__reduce__", [](const F& f) {
        const py::object find = py::module_::import("sfmcpp.model").attr("constraint_kind");
        return py::make_tuple(find, py::make_tuple(f.name));
      });
  py::list kinds;
  for (const F& facts : EnumTraits<residuals::ConstraintKind>::kTable)
    kinds.append(py::cast(facts));
  m.attr("CONSTRAINT_KINDS") = py::tuple(kinds);
}

residuals::ConstraintSet constraints_of(const py::dict& arrays, const ba::Problem& problem) {
  residuals::ConstraintSet set;
  if (!arrays.contains("constraints")) return set;
  for (const py::handle group : arrays["constraints"])
    set.add(group_of(py::reinterpret_borrow<py::dict>(group), problem));
  return set;
}

}  // namespace sfmcpp::bindings

// From what is fixed and shared to the parameter map of the solver.
#pragma once

#include <array>
#include <string_view>
#include <vector>

#include "sfmcpp/ba/gauge.hpp"
#include "sfmcpp/ba/problem.hpp"
#include "sfmcpp/core/enum_names.hpp"
#include "sfmcpp/linear/observation_graph.hpp"
#include "sfmcpp/linear/parameter_map.hpp"

namespace sfmcpp {

namespace ba {
// Bundle adjustment determines a scene up to a similarity. `free`: damping holds those seven
// degrees of freedom. `fixed`: as many pose parameters stay as they are as there is freedom left by
// what is fixed and by constraints (ba/gauge.hpp). `auto`: fixed for a method without damping.
enum class Gauge { kAuto, kFree, kFixed };
}  // namespace ba

template <>
struct EnumTraits<ba::Gauge> {
  static constexpr std::string_view kWhat = "gauge";
  static constexpr auto kTable = std::to_array<EnumRow<ba::Gauge>>(
      {{ba::Gauge::kAuto, "auto", "fixed for a method without damping, else free"},
       {ba::Gauge::kFree, "free", "damping holds the similarity freedom"},
       {ba::Gauge::kFixed, "fixed", "the first pose and the scale stay as they are"}});
};

namespace ba {

// The intrinsic parameters that have a column: those free in a row that an observed camera uses.
std::vector<int> free_intrinsics(const Problem& problem, const linear::ObservationGraph& graph);

// Cameras, rows of intrinsics and points without observations get no column, but for the poses that
// constraints hold (held_cameras.hpp), nor do the pose parameters in `gauge` (choose_gauge;
// sorted). The columns are the same on every rank.
linear::ParameterMap make_parameter_map(const Problem& problem,
                                        const linear::ObservationGraph& graph,
                                        const std::vector<int>& free_intrinsics,
                                        const std::vector<PoseParameter>& gauge = {});

}  // namespace ba
}  // namespace sfmcpp

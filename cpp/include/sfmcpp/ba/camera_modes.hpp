// What a neighbourhood of cameras may do as one.
#pragma once

#include "sfmcpp/ba/problem.hpp"
#include "sfmcpp/linear/normal_equations.hpp"
#include "sfmcpp/linear/parameter_map.hpp"

namespace sfmcpp::ba {

// The seven similarities and each free intrinsic parameter; none for projective cameras.
void set_camera_modes(const Problem& problem,
                      const linear::ParameterMap& map,
                      const optim::State& state,
                      linear::CameraModes& modes);

}  // namespace sfmcpp::ba

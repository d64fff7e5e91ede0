// The rules of a set of constraints; each throws InvalidArgument naming what breaks it.
#pragma once

#include <string>

#include "sfmcpp/residuals/constraint_set.hpp"

namespace sfmcpp::residuals {

void check_weight(const std::string& name, double weight);

// What holds whatever the cameras are.
void check_group(const ConstraintGroup& group);

// What holds for these cameras only.
void check_member(const ConstraintGroup& group,
                  std::size_t member,
                  const ConstrainedCameras& cameras);

}  // namespace sfmcpp::residuals

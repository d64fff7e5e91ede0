// Constraints of every kind on the cameras of a scene, near what its truth fulfils.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "support/dense_reference.hpp"
#include "support/enumerators.hpp"

namespace sfmcpp::support {

std::vector<residuals::ConstraintKind> all_constraint_kinds();
std::vector<residuals::ConstraintKind> pose_constraint_kinds();

// A member for each pair (previous, camera); kinds on one camera take the second. Measured with an
// error of about `noise` radians, metres, or tenths of the focal length. Named after its kind.
residuals::ConstraintGroup random_group(const OwnedProblem& scene,
                                        residuals::ConstraintKind kind,
                                        const std::vector<std::pair<int, int>>& cameras,
                                        double noise = 0.03,
                                        unsigned seed = 4);

// The dense system with two rows … of every constraint below those of the observations, from
// residuals/pose_constraints.hpp alone.
DenseSystem make_constrained_system(const LinearizedProblem& linearized);

}  // namespace sfmcpp::support

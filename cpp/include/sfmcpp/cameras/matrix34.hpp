// Row-major 3×4 matrices, as cameras are stored. Not in pose.hpp, which kernels include: what is
// compiled for several instruction sets is free of Eigen, whose inline functions the linker would
// take from any of them.
#pragma once

#include <Eigen/Core>

namespace sfmcpp {

using Matrix34 = Eigen::Matrix<double, 3, 4, Eigen::RowMajor>;

using PoseMatrix = Matrix34;  // [R | c] of a camera, a frame or a sensor (pose.hpp)
using PoseMatrixView = Eigen::Map<const PoseMatrix>;

}  // namespace sfmcpp

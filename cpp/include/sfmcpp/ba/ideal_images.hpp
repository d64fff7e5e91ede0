// A problem as cameras without distortion see it: projection matrices and pixels.
#pragma once

#include "sfmcpp/ba/problem.hpp"

namespace sfmcpp::ba {

// 3×4, row-major, to pixels, for each camera: K [Rᵀ | −Rᵀc] of metric ones.
void projection_matrices(const Problem& problem, double* matrices);

// Two numbers per observation: where a lens of the same pinhole without distortion would have seen
// it.
void undistort_pixels(const Problem& problem, double* pixels);

}  // namespace sfmcpp::ba

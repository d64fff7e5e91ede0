// Decompositions of small dense matrices, compiled once: a file that instantiates Eigen's takes ten
// seconds to compile.
#pragma once

#include <Eigen/Core>

namespace sfmcpp {

// S = V diag(λ) Vᵀ.
struct Spectrum {
  Eigen::VectorXd values;   // ascending
  Eigen::MatrixXd vectors;  // a column each
};

// Of a symmetric matrix, of which the lower half is read.
Spectrum symmetric_spectrum(const Eigen::MatrixXd& matrix);

// Orthonormal columns that span those of a matrix with at least as many rows.
Eigen::MatrixXd orthonormal_columns(const Eigen::MatrixXd& matrix);

}  // namespace sfmcpp

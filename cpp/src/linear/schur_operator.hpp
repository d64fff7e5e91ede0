// How the iterative solver multiplies with the Schur complement.
#pragma once

#include <memory>
#include <vector>

#include "sfmcpp/linear/camera_block_diagonal.hpp"
#include "sfmcpp/linear/point_elimination.hpp"
#include "sfmcpp/linear/reduced_structure.hpp"

namespace sfmcpp::linear {

class SchurOperator {
 public:
  virtual ~SchurOperator() = default;
  // For the factors that the elimination of the points has now: the diagonal blocks and the
  // right-hand side (CameraBlockDiagonal), and whatever the product needs.
  virtual void assemble(CameraBlockDiagonal& diagonal, std::vector<double>& rhs) = 0;
  // out += Pᵀ S P x of what this rank has of S; neither B of camera_terms.hpp nor λD.
  virtual void add_product(const std::vector<double>& x, std::vector<double>& out) = 0;
  // Whether the product reads or adds to columns of each camera.
  virtual std::vector<char> touched_cameras() const = 0;
  // Whether entries of S are rounded to single precision.
  virtual bool is_rounded() const = 0;
};

// The references must outlive the operator.
std::unique_ptr<SchurOperator> make_implicit_schur(const NormalEquations& normal,
                                                   PointElimination& elimination);
}  // namespace sfmcpp::linear

// Terms of the normal equations of residuals that see cameras alone, such as constraints on poses:
//   B = Σ Jᵀ J,   b = Σ Jᵀ r,   r(δ) = r − J δ,   each residual of one camera or of two.
// They are added to U and to Jcᵀ r (normal_equations.hpp); a pair of cameras may share no point.
//
// Which pairs meet is fixed at construction. B is kept in D×D blocks (i, j), i ≤ j, in the columns
// of camera blocks and in panel layout: as the block rows of the Schur complement.
#pragma once

#include <utility>
#include <vector>

#include "sfmcpp/core/compensated_sum.hpp"
#include "sfmcpp/linear/parameter_map.hpp"

namespace sfmcpp::linear {

// Cameras that a residual relates, in any order; equal: it sees one camera.
using CameraPairs = std::vector<std::pair<int, int>>;

inline constexpr int kNoCamera = -1;

// Jacobians are row-major, rows × D.
struct CameraResidual {
  int rows = 0;
  const double* residual = nullptr;
  int camera = 0;
  const double* by_camera = nullptr;
  int other = kNoCamera;
  const double* by_other = nullptr;
};

class CameraTerms {
 public:
  CameraTerms(int num_cameras, int camera_size, CameraPairs pairs);

  bool empty() const { return column_.empty(); }
  // The pairs, (smaller, larger), sorted, each once, with (i, i) for each camera of a pair.
  const CameraPairs& pairs() const { return pairs_; }

  void set_zero();
  // Its cameras must be one of the pairs.
  void add(const CameraResidual& residual);

  // Pᵀ b and diag(Pᵀ B P), added.
  void add_rhs(const ParameterMap& map, std::vector<double>& rhs) const;
  void add_diagonal(const ParameterMap& map, std::vector<double>& diagonal) const;
  // out += Pᵀ B P x
  void add_product(const ParameterMap& map,
                   const std::vector<double>& x,
                   std::vector<double>& out) const;
  // The same of the blocks of some rows, and of their transposes. `rows`: for each camera, whether
  // its row is one of them.
  void add_product(const ParameterMap& map,
                   const std::vector<char>& rows,
                   const std::vector<double>& x,
                   std::vector<CompensatedSum>& out) const;
  // xᵀ Pᵀ B P x
  double quadratic_form(const ParameterMap& map, const std::vector<double>& x) const;

  // Calls f(j, values) for each block (i, j), j ≥ i, of row i; the first is (i, i).
  template <class F>
  void for_each_block(int i, const F& f) const {
    if (empty()) return;
    for (int b = row_begin_[i]; b < row_begin_[i + 1]; ++b) f(column_[b], block(b));
  }

 private:
  int find(int i, int j) const;
  const double* block(int b) const { return blocks_.data() + static_cast<long>(size_) * size_ * b; }
  double entry(int b, int row, int column) const { return block(b)[place_[size_ * row + column]]; }
  void add_shared_diagonal(int b,
                           const int* columns_of_i,
                           const int* columns_of_j,
                           std::vector<double>& diagonal) const;
  template <class Number>
  void add_product_of_block(std::size_t b,
                            const ParameterMap& map,
                            const std::vector<double>& x,
                            std::vector<Number>& out) const;
  void add_rhs_of(int camera, const CameraResidual& residual, const double* jacobian);
  void add_block(int rows, int i, const double* by_i, int j, const double* by_j);

  int size_;  // D
  CameraPairs pairs_;
  std::vector<int> place_;      // of an entry of a block, row after row, in its panels
  std::vector<int> row_begin_;  // blocks of row i: [row_begin_[i], row_begin_[i + 1])
  std::vector<int> column_;     // camera j of each block, ascending within a row
  std::vector<double> blocks_;
  std::vector<double> rhs_;  // b, a camera block for each camera
};

}  // namespace sfmcpp::linear

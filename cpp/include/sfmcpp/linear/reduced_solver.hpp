// Direct solution of the reduced camera system (Pᵀ S P + diag) x = rhs, with S given by camera
// blocks.
#pragma once

#include <memory>
#include <vector>

#include "sfmcpp/core/parallel.hpp"
#include "sfmcpp/linear/camera_blocks.hpp"
#include "sfmcpp/linear/panel_layout.hpp"
#include "sfmcpp/linear/parameter_map.hpp"

namespace sfmcpp::linear {

// The matrix is handed over row by row: start, add_row for every camera, then factorize once and
// solve for any right-hand side.
class ReducedSolver {
 public:
  virtual ~ReducedSolver() = default;

  // Sets the matrix to diag.
  virtual void start(const std::vector<double>& diagonal) = 0;
  // Adds the blocks of camera row i, panel layout. Rows of cameras that share no column may be
  // added at the same time by several threads; else the order of the calls is the order of the
  // sums.
  virtual void add_row(int i, const double* row_blocks) = 0;
  // False if the matrix is not positive definite.
  virtual bool factorize() = 0;
  // `x` holds the right-hand side before and the solution after; false if that is not finite.
  virtual bool solve(std::vector<double>& x) = 0;
};

// The references must outlive the solver. The sparse one analyses the pattern once, here.
std::unique_ptr<ReducedSolver> make_dense_reduced_solver(const CameraPattern& pattern,
                                                         const ParameterMap& map,
                                                         ThreadPool& pool);
std::unique_ptr<ReducedSolver> make_sparse_reduced_solver(const CameraPattern& pattern,
                                                          const ParameterMap& map);

// Calls f(row, column, value), row ≥ column, for what the blocks of camera row i add to the lower
// triangle of Pᵀ S P. An entry may come up several times: its value is the sum.
template <class F>
void for_each_reduced_entry(const CameraPattern& pattern,
                            const ParameterMap& map,
                            int i,
                            const double* row_blocks,
                            const F& f) {
  const int size = map.camera_size;
  const int* rows = map.columns_of(i);
  for (long block = pattern.row_begin[i]; block < pattern.row_begin[i + 1]; ++block) {
    const int j = pattern.column[block];
    const int* columns = map.columns_of(j);
    const double* values = row_blocks + (block - pattern.row_begin[i]) * size * size;
    int first = 0;
    while (first < size) {
      const int width = panel_width(size - first);
      const double* panel = values + first * size;
      for (int c = 0; c < size; ++c) {
        if (columns[c] == kNoColumn) continue;
        for (int r = first; r < first + width; ++r) {
          const double value = panel[c * width + r - first];
          if (rows[r] == kNoColumn || (i == j && rows[r] < columns[c])) continue;
          if (rows[r] == columns[c]) {
            // A shared parameter meets itself: blocks (i, j) and (j, i) both add to the diagonal.
            f(rows[r], rows[r], i == j ? value : 2.0 * value);
          } else if (rows[r] > columns[c]) {
            f(rows[r], columns[c], value);
          } else {
            f(columns[c], rows[r], value);
          }
        }
      }
      first += width;
    }
  }
}

}  // namespace sfmcpp::linear

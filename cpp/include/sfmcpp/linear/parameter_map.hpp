// From the columns of camera blocks to the columns of the reduced camera system.
//
// The Jacobian has one block of `camera_size` columns per camera, as if every camera had intrinsics
// of its own. With P the 0/1 matrix that copies a reduced parameter to all its columns, the system
// of the free, shared parameters is Pᵀ (U − W V⁻¹ Wᵀ) P: elimination of the points does not depend
// on P. So fixed cameras, single fixed intrinsics, a fixed gauge, padding columns (all: no reduced
// column), and intrinsics of groups and poses of rigs (several columns: one) are one mechanism.
#pragma once

#include <vector>

namespace sfmcpp::linear {

inline constexpr int kNoColumn = -1;

struct ParameterMap {
  int camera_size = 0;              // columns of a camera block
  int num_columns = 0;              // columns of the reduced system
  std::vector<int> column;          // num_cameras × camera_size → reduced column or kNoColumn
  std::vector<int> block_begin;     // variable blocks of the reduced system, and the end
  std::vector<int> block_of;        // variable block of each reduced column
  std::vector<char> is_intrinsic;   // per reduced column; others are of poses
  bool has_shared_columns = false;  // do several cameras have one reduced column?
  std::vector<char> free_point;     // per point: may it move?

  int num_blocks() const { return static_cast<int>(block_begin.size()) - 1; }
  const int* columns_of(int camera) const {
    return column.data() + static_cast<long>(camera) * camera_size;
  }

  // Copies reduced values to the columns of a camera; zero where there is no column (P x).
  void expand(const double* reduced, int camera, double* block) const;
  // Adds the columns of a camera to reduced values (Pᵀ y): numbers, or compensated sums.
  template <class Number>
  void fold(const double* block, int camera, Number* reduced) const {
    const int* columns = columns_of(camera);
    for (int k = 0; k < camera_size; ++k) {
      if (columns[k] != kNoColumn) reduced[columns[k]] += block[k];
    }
  }
};

// Reduced columns by the number of their cameras: sums over cameras are made in parallel where each
// column belongs to one camera, and in the order of the cameras where several share it.
enum class Columns { kOfOneCamera, kShared };

// Whether each reduced column is shared.
std::vector<char> shared_columns(const ParameterMap& map);

// The same columns in another order: those of all poses, then all intrinsics. Variable blocks that
// have both are cut in two.
struct PosesFirst {
  ParameterMap map;        // without points
  std::vector<int> place;  // of each reduced column
  int num_poses = 0;       // columns
};
PosesFirst poses_first(const ParameterMap& map);

inline constexpr int kMaxCameraSize = 18;

// Sizes of camera block that the kernels are compiled for; larger blocks are padded up to one.
int padded_camera_size(int free_parameters);

}  // namespace sfmcpp::linear

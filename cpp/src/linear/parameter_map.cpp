#include "sfmcpp/linear/parameter_map.hpp"

namespace sfmcpp::linear {

void ParameterMap::expand(const double* reduced, int camera, double* block) const {
  const int* columns = columns_of(camera);
  for (int k = 0; k < camera_size; ++k)
    block[k] = columns[k] == kNoColumn ? 0.0 : reduced[columns[k]];
}

std::vector<char> shared_columns(const ParameterMap& map) {
  std::vector<char> cameras(map.num_columns, 0);  // of each column, up to two
  for (int column : map.column) {
    if (column != kNoColumn) cameras[column] += cameras[column] < 2;
  }
  for (char& count : cameras) count = count > 1;
  return cameras;
}

PosesFirst poses_first(const ParameterMap& map) {
  PosesFirst result;
  result.place.resize(map.num_columns);
  ParameterMap& ordered = result.map;
  ordered.camera_size = map.camera_size;
  ordered.num_columns = map.num_columns;
  ordered.column = map.column;
  ordered.has_shared_columns = map.has_shared_columns;
  ordered.block_begin.reserve(2 * map.block_begin.size());
  ordered.block_of.reserve(map.block_of.size());
  ordered.is_intrinsic.reserve(map.is_intrinsic.size());
  for (const char intrinsic : {0, 1}) {
    if (intrinsic != 0) result.num_poses = static_cast<int>(ordered.block_of.size());
    int last_block = kNoColumn;
    for (int k = 0; k < map.num_columns; ++k) {
      if (map.is_intrinsic[k] != intrinsic) continue;
      result.place[k] = static_cast<int>(ordered.block_of.size());
      if (map.block_of[k] != last_block) ordered.block_begin.push_back(result.place[k]);
      last_block = map.block_of[k];
      ordered.block_of.push_back(static_cast<int>(ordered.block_begin.size()) - 1);
      ordered.is_intrinsic.push_back(intrinsic);
    }
  }
  ordered.block_begin.push_back(map.num_columns);
  for (int& column : ordered.column) {
    if (column != kNoColumn) column = result.place[column];
  }
  return result;
}

int padded_camera_size(int free_parameters) {
  for (int size : {6, 9, 12}) {
    if (free_parameters <= size) return size;
  }
  return kMaxCameraSize;
}

}  // namespace sfmcpp::linear

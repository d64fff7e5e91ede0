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

int padded_camera_size(int free_parameters) {
  for (int size : {6, 9, 12}) {
    if (free_parameters <= size) return size;
  }
  return kMaxCameraSize;
}

}  // namespace sfmcpp::linear

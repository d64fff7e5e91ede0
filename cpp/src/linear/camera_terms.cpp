#include "sfmcpp/linear/camera_terms.hpp"

#include <algorithm>
#include <numeric>

#include "sfmcpp/core/error.hpp"
#include "sfmcpp/linear/block_layout.hpp"

namespace sfmcpp::linear {
namespace {

CameraPairs with_diagonal(CameraPairs pairs) {
  const std::size_t given = pairs.size();
  for (std::size_t k = 0; k < given; ++k) {
    auto& [i, j] = pairs[k];
    if (i > j) std::swap(i, j);
    const std::pair<int, int> first(i, i), second(j, j);
    pairs.push_back(first);
    pairs.push_back(second);
  }
  std::sort(pairs.begin(), pairs.end());
  pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());
  return pairs;
}

}  // namespace

CameraTerms::CameraTerms(int num_cameras, int camera_size, CameraPairs pairs)
    : size_(camera_size), pairs_(with_diagonal(std::move(pairs))) {
  if (pairs_.empty()) return;
  place_ = panel_places(size_);
  row_begin_.assign(static_cast<std::size_t>(num_cameras) + 1, 0);
  for (const auto& [i, j] : pairs_) {
    ++row_begin_[i + 1];
    column_.push_back(j);
  }
  std::partial_sum(row_begin_.begin(), row_begin_.end(), row_begin_.begin());
  const auto size = static_cast<std::size_t>(size_);
  blocks_.resize(pairs_.size() * size * size);
  rhs_.resize(static_cast<std::size_t>(num_cameras) * size);
}

void CameraTerms::set_zero() {
  std::fill(blocks_.begin(), blocks_.end(), 0.0);
  std::fill(rhs_.begin(), rhs_.end(), 0.0);
}

int CameraTerms::find(int i, int j) const {
  const auto found = std::lower_bound(pairs_.begin(), pairs_.end(), std::pair(i, j));
  if (found == pairs_.end() || *found != std::pair(i, j))
    throw Error("a residual relates two cameras that were not announced as a pair");
  return static_cast<int>(found - pairs_.begin());
}

void CameraTerms::add(const CameraResidual& r) {
  add_rhs_of(r.camera, r, r.by_camera);
  add_block(r.rows, r.camera, r.by_camera, r.camera, r.by_camera);
  if (r.other == kNoCamera) return;
  add_rhs_of(r.other, r, r.by_other);
  add_block(r.rows, r.other, r.by_other, r.other, r.by_other);
  if (r.camera < r.other) {
    add_block(r.rows, r.camera, r.by_camera, r.other, r.by_other);
  } else {
    add_block(r.rows, r.other, r.by_other, r.camera, r.by_camera);
  }
}

void CameraTerms::add_rhs_of(int camera, const CameraResidual& r, const double* jacobian) {
  double* rhs = rhs_.data() + static_cast<long>(size_) * camera;
  for (int row = 0; row < r.rows; ++row) {
    for (int k = 0; k < size_; ++k)
      rhs[k] += jacobian[static_cast<long>(size_) * row + k] * r.residual[row];
  }
}

void CameraTerms::add_block(int rows, int i, const double* by_i, int j, const double* by_j) {
  double* out = blocks_.data() + static_cast<long>(size_) * size_ * find(i, j);
  for (int row = 0; row < rows; ++row) {
    const double* a = by_i + static_cast<long>(size_) * row;
    const double* b = by_j + static_cast<long>(size_) * row;
    for (int r = 0; r < size_; ++r) {
      if (a[r] == 0.0) continue;
      for (int c = 0; c < size_; ++c) out[place_[size_ * r + c]] += a[r] * b[c];
    }
  }
}

void CameraTerms::add_rhs(const ParameterMap& map, std::vector<double>& rhs) const {
  for (const auto& [i, j] : pairs_) {
    if (i == j) map.fold(rhs_.data() + static_cast<long>(size_) * i, i, rhs.data());
  }
}

void CameraTerms::add_diagonal(const ParameterMap& map, std::vector<double>& diagonal) const {
  double values[kMaxCameraSize];
  for (std::size_t b = 0; b < pairs_.size(); ++b) {
    const auto& [i, j] = pairs_[b];
    if (i != j) {
      add_shared_diagonal(static_cast<int>(b), map.columns_of(i), map.columns_of(j), diagonal);
      continue;
    }
    for (int k = 0; k < size_; ++k) values[k] = entry(static_cast<int>(b), k, k);
    map.fold(values, i, diagonal.data());
  }
}

// Where both cameras of a block have a column, the block and its transpose meet on the diagonal.
void CameraTerms::add_shared_diagonal(int b,
                                      const int* columns_of_i,
                                      const int* columns_of_j,
                                      std::vector<double>& diagonal) const {
  for (int r = 0; r < size_; ++r) {
    if (columns_of_i[r] == kNoColumn) continue;
    for (int c = 0; c < size_; ++c) {
      if (columns_of_i[r] == columns_of_j[c]) diagonal[columns_of_i[r]] += 2.0 * entry(b, r, c);
    }
  }
}

void CameraTerms::add_product(const ParameterMap& map,
                              const std::vector<double>& x,
                              std::vector<double>& out) const {
  for (std::size_t b = 0; b < pairs_.size(); ++b) add_product_of_block(b, map, x, out);
}

void CameraTerms::add_product(const ParameterMap& map,
                              const std::vector<char>& rows,
                              const std::vector<double>& x,
                              std::vector<CompensatedSum>& out) const {
  for (std::size_t b = 0; b < pairs_.size(); ++b) {
    if (rows[pairs_[b].first]) add_product_of_block(b, map, x, out);
  }
}

template <class Number>
void CameraTerms::add_product_of_block(std::size_t b,
                                       const ParameterMap& map,
                                       const std::vector<double>& x,
                                       std::vector<Number>& out) const {
  double xi[kMaxCameraSize], xj[kMaxCameraSize], yi[kMaxCameraSize], yj[kMaxCameraSize];
  const auto& [i, j] = pairs_[b];
  map.expand(x.data(), i, xi);
  map.expand(x.data(), j, xj);
  std::fill_n(yi, size_, 0.0);
  std::fill_n(yj, size_, 0.0);
  for (int r = 0; r < size_; ++r) {
    for (int c = 0; c < size_; ++c) {
      const double value = entry(static_cast<int>(b), r, c);
      yi[r] += value * xj[c];
      yj[c] += value * xi[r];
    }
  }
  map.fold(yi, i, out.data());
  if (i != j) map.fold(yj, j, out.data());
}

double CameraTerms::quadratic_form(const ParameterMap& map, const std::vector<double>& x) const {
  if (empty()) return 0.0;
  std::vector<double> product(x.size(), 0.0);
  add_product(map, x, product);
  return std::inner_product(x.begin(), x.end(), product.begin(), 0.0);
}

}  // namespace sfmcpp::linear

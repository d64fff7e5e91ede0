#include "coarse_space.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "sfmcpp/linear/block_layout.hpp"

namespace sfmcpp::linear {
namespace {

// Cameras in an aggregate. On cities of 3,000 and 10,000 cameras 4 to 8 take the same time, 12 and
// 20 more: iterations grow with them, and the factor of the coarse matrix no longer counts.
constexpr int kCamerasOfAggregate = 6;
// A mode that keeps less than this share of its norm beside the others is none of its own.
constexpr double kIndependent = 1e-4;

// Whose cameras meet.
std::vector<std::pair<int, int>> edges_of(const Aggregates& aggregates,
                                          const CameraNeighbours& neighbours) {
  std::vector<std::pair<int, int>> edges;
  std::vector<int> met_by(aggregates.count(), -1);
  for (int k = 0; k < aggregates.count(); ++k) {
    const std::size_t first = edges.size();
    for (int m = aggregates.begin[k]; m < aggregates.begin[k + 1]; ++m) {
      const int i = aggregates.members[m];
      for (long n = neighbours.begin[i]; n < neighbours.begin[i + 1]; ++n) {
        const int other = aggregates.of_camera[neighbours.camera[n]];
        if (other > k && std::exchange(met_by[other], k) != k) edges.emplace_back(k, other);
      }
    }
    std::sort(edges.begin() + static_cast<long>(first), edges.end());
  }
  return edges;
}

}  // namespace

CoarseSpace::CoarseSpace(const NormalEquations& normal,
                         const BlockSparseSchur& schur,
                         const CameraPartition& partition,
                         CameraNeighbours neighbours,
                         std::shared_ptr<const ReducedStructure> structure)
    : normal_(normal),
      schur_(schur),
      partition_(partition),
      neighbours_(std::move(neighbours)),
      structure_(std::move(structure)),
      place_(panel_places(size())),
      scratch_(normal.pool().num_threads()) {
  for (int column : normal.map().column)
    own_.push_back(static_cast<char>(column != kNoColumn && !normal.is_shared(column)));
}

void CoarseSpace::factor(const std::vector<double>& diagonal) {
  usable_ = false;
  if (num_modes() == 0) return;
  if (!cholesky_) analyse();
  z_.resize(own_.size() * static_cast<std::size_t>(num_modes()));
  std::ranges::fill(blocks_, 0.0);
  set_weights(diagonal);
  normal_.pool().parallel_for(aggregates_.count(), [&](int k) { set_modes(k); });
  middle_ = middle_of_matrix();
  normal_.pool().parallel_for_worker(
      aggregates_.count(), [&](int k, int worker) { add_rows(k, diagonal, scratch_[worker]); });
  normal_.exchange().sum(blocks_);
  set_matrix();
  usable_ = cholesky_->factorize(normal_.pool());
}

void CoarseSpace::analyse() {
  if (structure_) {
    neighbours_ =
        neighbours_of(normal_.graph(), structure_->pattern, normal_.pool(), normal_.exchange());
    structure_.reset();
  }
  aggregates_ = aggregate_cameras(neighbours_, kCamerasOfAggregate);
  graph_.edges = edges_of(aggregates_, neighbours_);
  neighbours_ = {};
  graph_.size.assign(aggregates_.count(), num_modes());
  adjacency_ = make_adjacency(graph_);
  const std::size_t blocks = graph_.size.size() + adjacency_.neighbour.size();
  blocks_.resize(blocks * static_cast<std::size_t>(num_modes() * num_modes()));
  supernodes_ = make_supernodes(graph_, order_blocks(graph_, normal_.pool()));
  cholesky_ = std::make_unique<SupernodalCholesky>(supernodes_);
  for (Scratch& scratch : scratch_) scratch.number.resize(graph_.size.size());
}

// With itself (number 0), or with a neighbour (1, 2, …).
double* CoarseSpace::block_of(int aggregate, int number) {
  return blocks_.data() + (adjacency_.begin[aggregate] + aggregate + number) *
                              static_cast<std::int64_t>(num_modes() * num_modes());
}

void CoarseSpace::set_matrix() {
  cholesky_->set_zero(normal_.pool());
  for (int k = 0; k < aggregates_.count(); ++k) {
    add_diagonal_block(k);
    int number = 0;
    for (int other : adjacency_.of(k)) add_block(k, other, block_of(k, ++number));
  }
}

// Whole, as is its transpose: each entry below the diagonal is a sum of two.
void CoarseSpace::add_diagonal_block(int aggregate) {
  const int modes = num_modes(), place = supernodes_.position[aggregate];
  const BlockPlace to = cholesky_->place(place, place);
  const double* block = block_of(aggregate, 0);
  for (int c = 0; c < modes; ++c) {
    for (int r = c; r < modes; ++r)
      cholesky_->values()[to.of(r, c)] += block[modes * r + c] + block[modes * c + r];
    double& pivot = cholesky_->values()[to.of(c, c)];
    if (pivot == 0.0) pivot = 1.0;  // no mode
  }
}

// A block of the rows of `row` and the columns of `column`, or its transpose if that lies below the
// diagonal.
void CoarseSpace::add_block(int row, int column, const double* block) {
  const int modes = num_modes();
  const int row_place = supernodes_.position[row], column_place = supernodes_.position[column];
  const bool is_below = row_place > column_place;
  const BlockPlace to = is_below ? cholesky_->place(row_place, column_place)
                                 : cholesky_->place(column_place, row_place);
  for (int r = 0; r < modes; ++r) {
    for (int c = 0; c < modes; ++c)
      cholesky_->values()[is_below ? to.of(r, c) : to.of(c, r)] += block[modes * r + c];
  }
}

// The rows of ranks are summed: on a grid the matrix has the same bits for every number of them
// (sum_grid.hpp). With modes of unit length in the metric of the weights, the sum over any rows of
// two of them is at most the root of the numbers of their columns (Cauchy–Schwarz).
double CoarseSpace::middle_of_matrix() const {
  int most = 0;
  for (int k = 0; k < aggregates_.count(); ++k)
    most = std::max(most, aggregates_.begin[k + 1] - aggregates_.begin[k]);
  return middle_of_sum(size(), most);
}

void CoarseSpace::set_modes(int aggregate) {
  const int modes = num_modes();
  for (int m = aggregates_.begin[aggregate]; m < aggregates_.begin[aggregate + 1]; ++m) {
    const int i = aggregates_.members[m];
    const double* from = normal_.camera_modes().of_camera(i, size());
    double* to = z_of(i);
    for (int k = 0; k < size(); ++k) {
      const bool own = own_[static_cast<std::size_t>(size()) * i + k] != 0;
      for (int c = 0; c < modes; ++c) to[modes * k + c] = own ? from[modes * k + c] : 0.0;
    }
  }
  orthonormalise(aggregate);
}

void CoarseSpace::set_weights(const std::vector<double>& diagonal) {
  const int cameras = normal_.graph().num_cameras;
  const auto add_diagonal_of = [this](int i, const double* block) {
    double* weights = weights_.data() + static_cast<long>(size()) * i;
    for (int k = 0; k < size(); ++k) weights[k] += block[place_[size() * k + k]];
  };
  weights_.assign(own_.size(), 0.0);
  for (int i = 0; i < cameras; ++i) add_diagonal_of(i, schur_.diagonal_block(i));
  normal_.exchange().sum(weights_);
  for (int i = 0; i < cameras; ++i) {
    normal_.camera_terms().for_each_block(i, [&](int j, const double* block) {
      if (j == i) add_diagonal_of(i, block);
    });
  }
  for (std::size_t entry = 0; entry < own_.size(); ++entry) {
    const int column = normal_.map().column[entry];
    weights_[entry] = column == kNoColumn ? 0.0 : weights_[entry] + diagonal[column];
  }
}

// Modified Gram–Schmidt in the metric of the diagonal of S, so that no unit counts.
void CoarseSpace::orthonormalise(int aggregate) {
  const int modes = num_modes();
  const auto for_each_entry = [&](const auto& f) {
    for (int m = aggregates_.begin[aggregate]; m < aggregates_.begin[aggregate + 1]; ++m) {
      const int i = aggregates_.members[m];
      for (int k = 0; k < size(); ++k)
        f(z_of(i) + modes * k, weights_[static_cast<std::size_t>(size()) * i + k]);
    }
  };
  const auto product = [&](int a, int b) {
    double sum = 0.0;
    for_each_entry([&](const double* z, double w) { sum += w * z[a] * z[b]; });
    return sum;
  };
  for (int c = 0; c < modes; ++c) {
    const double before = product(c, c);
    for (int pass = 0; pass < 2; ++pass) {
      for (int a = 0; a < c; ++a) {
        const double share = product(a, c);
        for_each_entry([&](double* z, double) { z[c] -= share * z[a]; });
      }
    }
    const double after = product(c, c);
    const bool independent = after > kIndependent * kIndependent * before && after > 0.0;
    const double scale = independent ? 1.0 / std::sqrt(after) : 0.0;
    for_each_entry([&](double* z, double) { z[c] *= scale; });
  }
}

// Cameras of other ranks have their rows of S, and their entries of r, there.
template <class F>
void CoarseSpace::for_each_member_here(int aggregate, const F& f) const {
  for (int m = aggregates_.begin[aggregate]; m < aggregates_.begin[aggregate + 1]; ++m) {
    if (partition_.is_own(aggregates_.members[m])) f(aggregates_.members[m]);
  }
}

// Calls f(column, row of Z) for the columns that are of this camera alone.
template <class F>
void CoarseSpace::for_each_own_column(int camera, const F& f) const {
  const int* columns = normal_.map().columns_of(camera);
  for (int k = 0; k < size(); ++k) {
    if (own_[static_cast<std::size_t>(size()) * camera + k])
      f(columns[k], z_of(camera) + static_cast<long>(num_modes()) * k);
  }
}

// The rows of S of the cameras i of an aggregate: Zᵢᵀ Σ Sᵢⱼ Zⱼ over the cameras j of each
// aggregate.
void CoarseSpace::add_rows(int aggregate, const std::vector<double>& diagonal, Scratch& scratch) {
  const long length = static_cast<long>(size()) * num_modes();
  const std::span<const int> neighbours = adjacency_.of(aggregate);
  scratch.number[aggregate] = 0;
  for (std::size_t k = 0; k < neighbours.size(); ++k)
    scratch.number[neighbours[k]] = static_cast<int>(k) + 1;
  scratch.sums.assign(static_cast<std::size_t>(length) * (neighbours.size() + 1), 0.0);
  scratch.is_touched.assign(neighbours.size() + 1, 0);
  const auto sums_of = [&](int j) {
    const int number = scratch.number[aggregates_.of_camera[j]];
    if (std::exchange(scratch.is_touched[number], 1) == 0) scratch.touched.push_back(number);
    return scratch.sums.data() + length * number;
  };
  for_each_member_here(aggregate, [&](int i) {
    add_row(i, diagonal, sums_of);
    for (int number : scratch.touched) {
      double* sums = scratch.sums.data() + length * number;
      add_to_block(i, sums, block_of(aggregate, number));
      std::fill_n(sums, length, 0.0);
      scratch.is_touched[number] = 0;
    }
    scratch.touched.clear();
  });
}

// Of the blocks on the diagonal a half, since the whole is this and its transpose.
template <class Sums>
void CoarseSpace::add_row(int i, const std::vector<double>& diagonal, const Sums& sums_of) const {
  const auto add = [&](int j, const double* block) {
    const double share = i == j ? 0.5 : 1.0;
    add_product(
        j, [&](int r, int c) { return share * block[place_[size() * r + c]]; }, sums_of(j));
  };
  add(i, schur_.diagonal_block(i));
  normal_.camera_terms().for_each_block(i, add);
  const float* block = schur_.blocks_of_row(i);
  for (int j : schur_.columns_behind(i)) {
    add_product(
        j,
        [&](int r, int c) {
          return block[place_[size() * c + r]] * schur_.powers(i)[r] * schur_.powers(j)[c];
        },
        sums_of(j));
    block += place_.size();
  }
  double* sums = sums_of(i);
  const double* z = z_of(i);
  for (int r = 0; r < size(); ++r) {
    const int column = normal_.map().columns_of(i)[r];
    const double half = column == kNoColumn ? 0.0 : 0.5 * diagonal[column];
    for (int k = num_modes() * r; k < num_modes() * (r + 1); ++k) sums[k] += half * z[k];
  }
}

// sums += B Z of the camera, for the block B of entries value(r, c).
template <class Value>
void CoarseSpace::add_product(int camera, const Value& value, double* sums) const {
  const int modes = num_modes();
  const double* z = z_of(camera);
  for (int c = 0; c < size(); ++c) {
    for (int r = 0; r < size(); ++r) {
      const double factor = value(r, c);
      for (int k = 0; k < modes; ++k) sums[modes * r + k] += factor * z[modes * c + k];
    }
  }
}

void CoarseSpace::add_to_block(int i, const double* sums, double* block) const {
  const int modes = num_modes();
  const double* z = z_of(i);
  for (int r = 0; r < size(); ++r) {
    for (int a = 0; a < modes; ++a) {
      for (int b = 0; b < modes; ++b)
        block[modes * a + b] += (z[modes * r + a] * sums[modes * r + b] + middle_) - middle_;
    }
  }
}

std::span<double> CoarseSpace::coarse_of(int aggregate) {
  const int place = supernodes_.position[aggregate];
  return std::span(coarse_).subspan(supernodes_.first_column[place], num_modes());
}

void CoarseSpace::add_correction(const std::vector<double>& r, std::vector<double>& z) {
  if (!usable_) return;
  sums_.assign(static_cast<std::size_t>(aggregates_.count()) * num_modes(), {});
  normal_.pool().parallel_for_worker(
      aggregates_.count(), [&](int k, int worker) { restrict(k, r, scratch_[worker].sums); });
  normal_.exchange().sum(sums_);
  coarse_.resize(sums_.size());
  for (int k = 0; k < aggregates_.count(); ++k)
    round_sums(std::span(sums_).subspan(num_modes() * k, num_modes()), coarse_of(k));
  cholesky_->solve(coarse_, normal_.pool());
  normal_.pool().parallel_for(aggregates_.count(), [&](int k) { prolong(k, z); });
}

// Zᵀ r of an aggregate: what a camera adds is of one rank, their sum may be of several.
void CoarseSpace::restrict(int aggregate,
                           const std::vector<double>& r,
                           std::vector<double>& of_camera) {
  const int modes = num_modes();
  CompensatedSum* sums = sums_.data() + static_cast<long>(modes) * aggregate;
  for_each_member_here(aggregate, [&](int i) {
    of_camera.assign(modes, 0.0);
    for_each_own_column(i, [&](int column, const double* row) {
      for (int c = 0; c < modes; ++c) of_camera[c] += row[c] * r[column];
    });
    for (int c = 0; c < modes; ++c) sums[c] += of_camera[c];
  });
}

void CoarseSpace::prolong(int aggregate, std::vector<double>& z) {
  const std::span<const double> sum = coarse_of(aggregate);
  for_each_member_here(aggregate, [&](int i) {
    for_each_own_column(i, [&](int column, const double* row) {
      for (int c = 0; c < num_modes(); ++c) z[column] += row[c] * sum[c];
    });
  });
}

}  // namespace sfmcpp::linear

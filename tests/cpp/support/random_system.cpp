#include "support/random_system.hpp"

#include <algorithm>

namespace sfmcpp::support {
namespace {

bool contains(const std::vector<int>& values, int value) {
  return std::find(values.begin(), values.end(), value) != values.end();
}

bool sees(const SystemOptions& options, int camera, int point) {
  if (options.sees) return options.sees(camera, point);
  const int after = (camera - point % options.cameras + options.cameras) % options.cameras;
  return options.window == 0 || after < options.window;
}

// Numbers the columns of the cameras, and then those of the groups. Every other column of a camera
// is called an intrinsic parameter: nothing depends on where they are.
class MapBuilder {
 public:
  explicit MapBuilder(const SystemOptions& options) : options_(options) {
    map_.camera_size = options.camera_size;
    map_.column.assign(static_cast<std::size_t>(options.cameras) * options.camera_size,
                       linear::kNoColumn);
    map_.has_shared_columns = options.groups > 0 && options.shared > 0;
  }

  linear::ParameterMap build() {
    const int used = options_.camera_size - options_.padding;
    const int own = used - (options_.groups > 0 ? options_.shared : 0);
    for (int i = 0; i < options_.cameras; ++i) {
      for (int k = 0; k < own; ++k) {
        if (is_free(i, k)) column(i, k) = next_column(k);
      }
      end_block();
    }
    for (int group = 0; group < options_.groups; ++group) {
      for (int k = own; k < used; ++k) {
        const int shared = next_column(k);
        for (int i = group; i < options_.cameras; i += options_.groups) column(i, k) = shared;
      }
      end_block();
    }
    map_.block_begin.push_back(map_.num_columns);
    return std::move(map_);
  }

 private:
  int& column(int camera, int k) {
    return map_.column[static_cast<std::size_t>(camera) * options_.camera_size + k];
  }
  int next_column(int k) {
    map_.is_intrinsic.push_back(static_cast<char>(k % 2));
    return next_++;
  }
  bool is_free(int camera, int k) const {
    const auto& fixed = options_.fixed_columns;
    return !contains(options_.fixed_cameras, camera) &&
           std::find(fixed.begin(), fixed.end(), std::pair(camera, k)) == fixed.end();
  }
  void end_block() {
    if (next_ == map_.num_columns) return;
    map_.block_begin.push_back(map_.num_columns);
    map_.block_of.resize(next_, static_cast<int>(map_.block_begin.size()) - 1);
    map_.num_columns = next_;
  }

  const SystemOptions& options_;
  linear::ParameterMap map_;
  int next_ = 0;
};

}  // namespace

linear::ObservationGraph make_graph(const SystemOptions& options, int rank, int num_ranks) {
  std::vector<int> cameras, points;
  int count = 0;
  for (int p = rank; p < options.points; p += num_ranks, ++count) {
    for (int i = 0; i < options.cameras; ++i) {
      if (!sees(options, i, p)) continue;
      cameras.push_back(i);
      points.push_back(count);
    }
  }
  return linear::make_observation_graph(options.cameras, count, cameras, points);
}

linear::ParameterMap make_map(const SystemOptions& options, int rank, int num_ranks) {
  linear::ParameterMap map = MapBuilder(options).build();
  for (int p = rank; p < options.points; p += num_ranks)
    map.free_point.push_back(!contains(options.fixed_points, p));
  return map;
}

RandomSystem::RandomSystem(const SystemOptions& options, Exchange& exchange)
    : graph(make_graph(options, exchange.rank(), exchange.num_ranks())),
      map(make_map(options, exchange.rank(), exchange.num_ranks())),
      pool_(options.threads),
      exchange_(exchange),
      normal_(graph, map, pool_, options.pairs, exchange, options.stored, options.compensated),
      random_(options.seed) {
  exchange.sum(graph.of_camera_on_all_ranks);
  add_observations(options);
  add_pairs(options);
  if (options.stored == linear::Precision::kSingle) round_coefficients();
  make_dense(options);
  fill();
}

RandomSystem::Matrix RandomSystem::random_matrix(int rows, int columns) {
  std::normal_distribution<double> normal;
  return Matrix::NullaryExpr(rows, columns, [&] { return normal(random_); });
}

// Columns of very different size, as those of radians and metres are.
RandomSystem::Matrix RandomSystem::random_camera_matrix(int rows, const SystemOptions& options) {
  Matrix matrix = random_matrix(rows, options.camera_size);
  for (int k = 0; k < options.camera_size; ++k) matrix.col(k) *= 1 << k % 6;
  for (int k : options.blind_columns) matrix.col(k).setZero();
  return matrix;
}

void RandomSystem::add_observations(const SystemOptions& options) {
  int row = 0;
  for (int i = 0; i < options.cameras; ++i) {
    for (int p = 0; p < options.points; ++p) {
      if (!sees(options, i, p)) continue;
      blocks_.push_back({.camera = i,
                         .point = p,
                         .row = row,
                         .by_camera = random_camera_matrix(2, options),
                         .by_other = random_matrix(2, 3)});
      row += 2;
    }
  }
}

void RandomSystem::add_pairs(const SystemOptions& options) {
  constexpr int kRows = 4;
  int row = blocks_.empty() ? 0 : blocks_.back().row + 2;
  for (const auto& [i, j] : options.pairs) {
    Block block{.camera = i, .row = row, .by_camera = random_camera_matrix(kRows, options)};
    if (i != j) {
      // Poses alone: the cameras may share the rest.
      block.other = j;
      block.by_other = random_camera_matrix(kRows, options);
      block.by_camera.rightCols(options.shared + options.padding).setZero();
      block.by_other.rightCols(options.shared + options.padding).setZero();
    }
    blocks_.push_back(block);
    row += kRows;
  }
}

// What single precision holds exactly.
void RandomSystem::round_coefficients() {
  for (Block& block : blocks_) {
    for (Matrix* matrix : {&block.by_camera, &block.by_other})
      *matrix = matrix->cast<float>().cast<double>().eval();
  }
}

void RandomSystem::make_dense(const SystemOptions& options) {
  dense_.camera_columns = map.num_columns;
  int columns = map.num_columns;
  for (int p = 0; p < options.points; ++p) {
    const bool fixed = contains(options.fixed_points, p);
    dense_.point_column.push_back(fixed ? -1 : columns);
    if (!fixed) columns += 3;
  }
  const int rows = blocks_.back().row + static_cast<int>(blocks_.back().by_camera.rows());
  dense_.residual = 10.0 * random_matrix(rows, 1);
  if (options.stored == linear::Precision::kSingle)
    dense_.residual = dense_.residual.cast<float>().cast<double>().eval();
  if (!options.dense) return;
  dense_.jacobian.setZero(rows, columns);
  const auto place = [&](const Block& block, int camera, const Matrix& jacobian) {
    for (int k = 0; k < options.camera_size; ++k) {
      const int column = map.columns_of(camera)[k];
      if (column == linear::kNoColumn) continue;
      dense_.jacobian.block(block.row, column, jacobian.rows(), 1) += jacobian.col(k);
    }
  };
  for (const Block& block : blocks_) {
    place(block, block.camera, block.by_camera);
    if (block.other != linear::kNoCamera) place(block, block.other, block.by_other);
    if (block.point >= 0 && dense_.point_column[block.point] >= 0)
      dense_.jacobian.block(block.row, dense_.point_column[block.point], 2, 3) = block.by_other;
  }
}

void RandomSystem::fill() {
  normal_.camera_terms().set_zero();
  std::vector<const Block*> stored;
  for (const Block& block : blocks_) {
    if (block.point < 0) {
      const Eigen::VectorXd residual = dense_.residual.segment(block.row, block.by_camera.rows());
      normal_.camera_terms().add({.rows = static_cast<int>(residual.size()),
                                  .residual = residual.data(),
                                  .camera = block.camera,
                                  .by_camera = block.by_camera.data(),
                                  .other = block.other,
                                  .by_other = block.by_other.data()});
    } else if (block.point % exchange_.num_ranks() == exchange_.rank()) {
      stored.push_back(&block);
    }
  }
  for (std::size_t c = 0; c < graph.chunks.size(); ++c) {
    normal_.fill(static_cast<int>(c),
                 [&](const linear::Chunk& part, double* jacobian, linear::PointRecord* records) {
                   for (int a = part.begin; a < part.end; ++a, ++records) {
                     fill(*stored[a], jacobian, *records);
                     jacobian += stored[a]->by_camera.size();
                   }
                 });
  }
  normal_.finish();
}

void RandomSystem::fill(const Block& block, double* jacobian, linear::PointRecord& record) const {
  std::copy_n(block.by_camera.data(), block.by_camera.size(), jacobian);
  for (int row = 0; row < 2; ++row) {
    auto& [by_point, residual] = record.row[row];
    for (int k = 0; k < 3; ++k) by_point[k] = block.by_other(row, k);
    residual = dense_.residual[block.row + row];
  }
}

linear::LinearSolveResult RandomSystem::solve(const linear::LinearSolverOptions& solver,
                                              const linear::Damping& damping,
                                              linear::Step& step) const {
  return linear::make_linear_solver(normal_, solver)->solve(damping, step, [] { return false; });
}

void RandomSystem::move(const linear::Step& step) {
  dense_.residual -= dense_.jacobian * flatten(dense_, step);
  fill();
}

std::vector<SystemOptions> random_systems() {
  return {
      {.name = "SixColumns", .window = 4},
      {.name = "SixColumnsSomeFixed", .window = 4, .fixed_cameras = {2}, .fixed_points = {0, 17}},
      {.name = "SixColumnsGaugeFixed",
       .window = 4,
       .fixed_columns = {{0, 0}, {0, 1}, {0, 2}, {0, 3}, {0, 4}, {0, 5}, {1, 3}}},
      {.name = "NineColumns", .camera_size = 9, .window = 4},
      {.name = "NineColumnsShared", .camera_size = 9, .shared = 3, .groups = 2, .window = 4},
      {.name = "TwelveColumnsOneGroupSomeFixed",
       .camera_size = 12,
       .padding = 1,
       .shared = 5,
       .groups = 1,
       .window = 4,
       .fixed_cameras = {2},
       .fixed_points = {0, 17}},
      {.name = "EighteenColumnsPadded", .camera_size = 18, .padding = 4, .window = 5}};
}

}  // namespace sfmcpp::support

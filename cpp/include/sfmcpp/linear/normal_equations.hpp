// The linearised problem at one state: Jacobian, gradient and the blocks that do not depend on
// damping.
//
// J = [Jc Jp], kept per observation; V = Σ JpᵀJp per point; b = Jᵀ r (docs/equations.md §2), so
// that −b is the gradient of the cost. U and W are never formed. Linearise once, solve for many
// dampings. Residuals that see cameras alone add their part of JᵀJ and Jᵀr as blocks
// (camera_terms.hpp).
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <variant>
#include <vector>

#include "sfmcpp/core/aligned.hpp"
#include "sfmcpp/core/exchange.hpp"
#include "sfmcpp/core/parallel.hpp"
#include "sfmcpp/linear/camera_terms.hpp"
#include "sfmcpp/linear/observation_graph.hpp"
#include "sfmcpp/linear/parameter_map.hpp"
#include "sfmcpp/linear/precision.hpp"
#include "sfmcpp/linear/schur_kernels.hpp"

namespace sfmcpp::linear {

// A step of the unknowns: reduced camera columns, and three numbers per point.
struct Step {
  std::vector<double> camera;
  std::vector<double> point;
};

enum class DampingMatrix { kIdentity, kDiagonal };

// λ D is added to JᵀJ, with D = I or D = diag(JᵀJ) kept away from zero.
struct Damping {
  double lambda = 0.0;
  DampingMatrix matrix = DampingMatrix::kDiagonal;

  double operator()(double diagonal_entry) const;
  bool operator==(const Damping&) const = default;
};

// Which JᵀJ + λD it is, but for intrinsics that are held.
struct DampedSystem {
  long linearization;
  Damping damping;
  bool operator==(const DampedSystem&) const = default;
};

// Derivative of the cost along the cameras' and along the points' part of a step.
struct Slopes {
  double camera = 0.0;
  double point = 0.0;
};

// Lower triangle of V = Σ Jpᵀ Jp, and Jpᵀ r, of a point.
struct PointBlock {
  double v00, v10, v11, v20, v21, v22;
  double rhs[3];

  std::array<double, 3> diagonal() const { return {v00, v11, v22}; }
};

// Directions of the cameras along which the cost is expected to change slowly when all cameras of a
// neighbourhood go along: the near-null space of S, for preconditioners. They are filled in by
// ba/world_motions.hpp, which knows what a camera is; count = 0: there are none.
struct CameraModes {
  int count = 0;
  std::vector<double> values;  // per camera: D × count, row-major

  double* of_camera(int camera, int camera_size) {
    return values.data() + static_cast<std::size_t>(camera) * camera_size * count;
  }
  const double* of_camera(int camera, int camera_size) const {
    return values.data() + static_cast<std::size_t>(camera) * camera_size * count;
  }
};

// Points, and cameras or their blocks, per parallel task: few where there are few, so that threads
// end together.
inline long points_per_task(long points) { return std::clamp(points / 32, 128L, 512L); }
inline long cameras_per_task(long cameras) { return std::clamp(cameras / 16, 8L, 64L); }
// Points per part of a sum.
inline constexpr int kPointsPerSum = 512;

// Calls f(begin, end) for consecutive points, in parallel.
template <class F>
void for_points(ThreadPool& pool, int num_points, const F& f) {
  pool.parallel_for_parts(num_points, points_per_task(num_points), [&](long begin, long end) {
    f(static_cast<int>(begin), static_cast<int>(end));
  });
}
// Calls f(p) for every point, and f(i) for every camera, in parallel.
template <class F>
void for_each_point(ThreadPool& pool, int num_points, const F& f) {
  for_points(pool, num_points, [&](int begin, int end) {
    for (int p = begin; p < end; ++p) f(p);
  });
}
template <class F>
void for_each_camera(ThreadPool& pool, int num_cameras, const F& f) {
  pool.parallel_for_parts(num_cameras, cameras_per_task(num_cameras), [&](long begin, long end) {
    for (long i = begin; i < end; ++i) f(static_cast<int>(i));
  });
}

class NormalEquations {
 public:
  // The references must outlive this object. `camera_pairs`: cameras that other residuals than
  // observations relate. `stored`: not auto. `compensated`: gradient and diagonal have the same
  // bits however points are divided among ranks, which conjugate gradients need for theirs.
  NormalEquations(const ObservationGraph& graph,
                  const ParameterMap& map,
                  ThreadPool& pool,
                  CameraPairs camera_pairs = {},
                  Exchange& exchange = this_process(),
                  Precision stored = Precision::kDouble,
                  bool compensated = false);

  // Filling: first the Jacobian (schur_kernels.hpp), chunk by chunk, in any order. Of a few
  // observations at a time, write(part, jacobian, records) sets J and A|r in double precision,
  // while they are in the nearest cache; J is 2×D, row-major …
  template <class F>
  void fill(int chunk, const F& write) {
    const Chunk& c = graph_.chunks[chunk];
    Draft draft;
    start(chunk);
    for (int begin = c.begin; begin < c.end; begin += kPartSize) {
      const Chunk part{c.camera, begin, std::min(begin + kPartSize, c.end)};
      const auto [jacobian, records] = place_of(part, draft);
      write(part, jacobian, records);
      take(part, jacobian, records, chunk);
    }
  }
  // … and the terms of cameras alone; then `finish`.
  CameraTerms& camera_terms() { return camera_terms_; }
  CameraModes& camera_modes() { return camera_modes_; }
  void finish();
  long num_linearizations() const { return num_linearizations_; }  // that were finished
  DampedSystem damped(const Damping& damping) const { return {num_linearizations_, damping}; }

  const ObservationGraph& graph() const { return graph_; }
  const ParameterMap& map() const { return map_; }
  ThreadPool& pool() const { return pool_; }
  Exchange& exchange() const { return exchange_; }
  const SchurKernels& kernels() const { return kernels_; }
  const CameraTerms& camera_terms() const { return camera_terms_; }
  const CameraModes& camera_modes() const { return camera_modes_; }

  Precision precision() const;
  bool is_compensated() const { return compensated_; }
  // For the kernels.
  StoredJacobian jacobian() const;
  // Σ Jᵀ r of a camera before rounding, for the kernels; null in double precision, where they find
  // it. At a minimum it is a small difference of large numbers: its rounding error would move the
  // state along the gauge and along other directions that damping alone determines. What was
  // rounded off comes behind it, where sums are compensated.
  const double* unrounded_gradient(int camera) const {
    return gradients_.empty() ? nullptr : gradients_.data() + gradient_size() * camera;
  }
  // J and A|r of an observation. Only where stored in double precision.
  const double* camera_jacobian(int observation) const;
  const PointRecord& point_record(int observation) const;
  // Zeros for a point that may not move.
  const PointBlock& point_block(int p) const { return point_blocks_[p]; }

  // Jcᵀ r and diag(JcᵀJc), in reduced columns, over all residuals.
  const std::vector<double>& camera_rhs() const { return camera_rhs_; }
  const std::vector<double>& camera_diagonal() const { return camera_diagonal_; }
  std::vector<double> camera_damping(const Damping& damping) const;  // λD
  void get_camera_damping(const Damping& damping, std::vector<double>& diagonal) const;
  // Holds the intrinsics: their entries of λD are so large that steps hardly move them, or not at
  // all where a solver leaves them out.
  void hold_intrinsics(bool held) { holds_intrinsics_ = held; }
  bool holds_intrinsics() const { return holds_intrinsics_; }
  double gradient_max_norm() const { return gradient_max_norm_; }
  double max_diagonal() const;

  // −bᵀδ, in its two parts.
  Slopes slopes(const Step& step) const;
  // ‖Jδ‖²: the quadratic model along the step is F + α slope + ½ α² curvature.
  double curvature(const Step& step) const;
  // Decrease of the quadratic model along the whole of any step: −slope − ½ curvature.
  double model_decrease(const Step& step) const;

  // The same for the δ that solves the damped system, without a pass over J: ½ δᵀ (b + λ D δ).
  double predicted_decrease(const Step& step, const Damping& damping) const;

  // Calls add(i, columns) for every camera: what cameras add to a reduced column is added in their
  // order.
  template <class F>
  void for_each_camera_in_order(const F& add) const {
    for_each_camera(pool_, graph_.num_cameras, [&](int i) { add(i, Columns::kOfOneCamera); });
    for (int i = 0; map_.has_shared_columns && i < graph_.num_cameras; ++i)
      add(i, Columns::kShared);
  }
  // Calls f(k, column) for those columns of a camera block.
  template <class F>
  void for_each_column(int camera, Columns columns, const F& f) const {
    const int* column = map_.columns_of(camera);
    for (int k = 0; k < map_.camera_size; ++k) {
      if (column[k] != kNoColumn && is_shared(column[k]) == (columns == Columns::kShared))
        f(k, column[k]);
    }
  }
  // Adds those columns of a camera block to reduced values (Pᵀ y).
  template <class Number>
  void fold(const double* block, int camera, Columns columns, Number* reduced) const {
    for_each_column(camera, columns, [&](int k, int column) { reduced[column] += block[k]; });
  }
  // Σ Pᵀ y over the chunks, with y of each, a camera block, in `blocks`, added.
  void fold_chunks(const double* blocks, long stride, double* reduced) const;
  // The same of compensated sums, with what is rounded off of a block so far behind it.
  void fold_chunks(const double* blocks, long stride, long rests, CompensatedSum* reduced) const;
  bool is_shared(int column) const { return shared_[column] != 0; }

 private:
  template <class T>
  struct Blocks {
    AlignedVector<T> jacobian;
    AlignedVector<PointRecordOf<T>> records;
    // What rounding took from Aᵀ r of each observation, four numbers; none in double precision.
    AlignedVector<float> lost;
  };
  static constexpr int kPartSize = 64;
  // Where a part is written that is not stored in double precision.
  struct Draft {
    alignas(64) double jacobian[kPartSize * 2 * kMaxCameraSize];
    PointRecord records[kPartSize];
  };
  struct Place {
    double* jacobian;
    PointRecord* records;
  };

  double damping_of(std::size_t column, const Damping& damping) const;
  void start(int chunk);
  long gradient_size() const { return (compensated_ ? 2L : 1L) * map_.camera_size; }
  // A gradient, a diagonal, and what is rounded off of both.
  long chunk_size() const { return 2 * gradient_size(); }
  void sum_chunks(long first, std::vector<double>& values);
  void sum_gradients();
  Place place_of(const Chunk& part, Draft& draft);
  void take(const Chunk& part, const double* jacobian, const PointRecord* records, int chunk);
  template <class T>
  PointBlock gathered(const Blocks<T>& blocks, int p) const;

  const ObservationGraph& graph_;
  const ParameterMap& map_;
  ThreadPool& pool_;
  Exchange& exchange_;
  bool compensated_;
  SchurKernels kernels_;
  CameraTerms camera_terms_;
  CameraModes camera_modes_;
  std::vector<char> shared_;  // per reduced column
  bool holds_intrinsics_ = false;
  std::variant<Blocks<double>, Blocks<float>> blocks_;
  AlignedVector<PointBlock> point_blocks_;
  AlignedVector<double> chunk_sums_;  // per chunk: gradient, then diagonal, of a camera block
  std::vector<CompensatedSum> column_sums_;  // room for sums of chunks
  AlignedVector<double> gradients_;          // of each camera block, where the Jacobian is rounded
  std::vector<double> camera_rhs_;
  std::vector<double> camera_diagonal_;
  double gradient_max_norm_ = 0.0;
  long num_linearizations_ = 0;
};

}  // namespace sfmcpp::linear

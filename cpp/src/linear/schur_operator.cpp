#include "schur_operator.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <type_traits>

#include "sfmcpp/core/isa.hpp"
#include "sfmcpp/linear/block_product_kernels.hpp"

namespace sfmcpp::linear {
namespace {

// S x without S or W: with e = Jc x, S x = Jcᵀ (e − G Σ Gᵀ e), the sum over the observations of
// each point; and G Σ Gᵀ e = A t with t = Mᵀ Σ Gᵀ e. Memory is that of the Jacobian.
class ImplicitSchur final : public SchurOperator {
 public:
  ImplicitSchur(const NormalEquations& normal, PointElimination& elimination)
      : normal_(normal), elimination_(elimination) {}

  void form(CameraBlockDiagonal& diagonal) override { diagonal.form(elimination_.factors()); }
  void gather(CameraBlockDiagonal& diagonal, std::vector<double>& rhs) const override {
    diagonal.gather(rhs, normal_.exchange());
  }
  bool is_rounded() const override { return false; }
  std::vector<char> touched_cameras() const override {
    std::vector<char> touched(normal_.graph().num_cameras);
    for (int i = 0; i < normal_.graph().num_cameras; ++i)
      touched[i] = normal_.graph().observations_of_camera(i) > 0;
    return touched;
  }

  void add_product(const std::vector<double>& x, std::vector<double>& out) override {
    std::vector<CompensatedSum> sums(out.begin(), out.end());
    add_product(x, sums);
    round_sums(sums, out);
  }

  void add_product(const std::vector<double>& x, std::vector<CompensatedSum>& out) override {
    const ObservationGraph& graph = normal_.graph();
    const long size = normal_.map().camera_size;
    shifts_.resize(3 * static_cast<std::size_t>(graph.num_points));
    chunk_sums_.resize(graph.chunks.size() * static_cast<std::size_t>(2 * size));
    set_shifts(elimination_.point_sums(x));
    normal_.pool().parallel_for(static_cast<int>(graph.chunks.size()), [&](int chunk) {
      const Chunk& c = graph.chunks[chunk];
      double* sum = chunk_sums_.data() + 2 * size * chunk;
      std::fill_n(sum, 2 * size, 0.0);
      normal_.kernels().schur_product(normal_.jacobian(),
                                      c.begin,
                                      c.end,
                                      graph.point.data(),
                                      shifts_.data(),
                                      elimination_.expanded(c.camera),
                                      sum);
    });
    normal_.fold_chunks(chunk_sums_.data(), 2 * size, size, out.data());
  }

 private:
  void set_shifts(const double* sums) {
    for_each_point(normal_.pool(), normal_.graph().num_points, [&](int p) {
      multiply_by_transposed_factor(elimination_.factor(p), sums + 3L * p, shifts_.data() + 3L * p);
    });
  }

  const NormalEquations& normal_;
  PointElimination& elimination_;
  AlignedVector<double> shifts_;      // t per point
  AlignedVector<double> chunk_sums_;  // per chunk: a camera block, and what is rounded off
};

}  // namespace

std::unique_ptr<SchurOperator> make_implicit_schur(const NormalEquations& normal,
                                                   PointElimination& elimination) {
  return std::make_unique<ImplicitSchur>(normal, elimination);
}

namespace {

constexpr int kMostTasks = 64, kFewestTasks = 4;
constexpr long kLeastBlocksPerTask = 512;
// The sums of tasks that reach over each other are written and read besides the blocks: no more
// than this share of their bytes.
constexpr double kMostOfSums = 0.15;

// Blocks in the row and in the column of a camera, of the camera that has most.
int most_blocks_of_camera(const CameraPattern& pattern) {
  std::vector<int> count(pattern.num_rows(), 0);
  for (int i = 0; i < pattern.num_rows(); ++i) {
    for (int j : pattern.columns_of_row(i)) {
      ++count[i];
      ++count[j];
    }
  }
  return count.empty() ? 0 : *std::ranges::max_element(count);
}

// Cameras of the rows of this rank.
std::vector<char> cameras_of(const CameraPattern& pattern, const CameraPartition& partition) {
  std::vector<char> result(pattern.num_rows(), 0);
  for (int i = 0; i < pattern.num_rows(); ++i) {
    if (!partition.is_own(i)) continue;
    for (int j : pattern.columns_of_row(i)) result[j] = 1;
  }
  return result;
}

}  // namespace

BlockProductKernels block_product_kernels(int camera_size) {
  return SFMCPP_FOR_ACTIVE_ISA(product_kernels_for(camera_size));
}

BlockSparseSchur::BlockSparseSchur(const NormalEquations& normal,
                                   PointElimination& elimination,
                                   const CameraPartition& partition,
                                   const std::shared_ptr<const ReducedStructure>& structure)
    : normal_(normal),
      schur_rows_(normal, elimination, partition, structure),
      pattern_(schur_rows_.pattern()),
      touched_(cameras_of(pattern_, partition)),
      kernels_(block_product_kernels(normal.map().camera_size)),
      tasks_(choose_tasks()),
      most_terms_(most_blocks_of_camera(structure->pattern)) {
  const auto size = static_cast<std::size_t>(normal.map().camera_size);
  const auto cameras = static_cast<std::size_t>(normal.graph().num_cameras);
  blocks_.resize(size * size * (static_cast<std::size_t>(pattern_.num_blocks()) - cameras));
  sums_.resize(numbers_of(tasks_));
  x_.assign(size * cameras, 0.0);  // stays zero where this rank touches no camera
  out_.resize(size * cameras);
  rows_.resize(normal.pool().num_threads() * schur_rows_.rows_at_once());
}

std::vector<BlockSparseSchur::RowTask> BlockSparseSchur::cut_rows(long blocks_per_task) const {
  std::vector<RowTask> tasks;
  const auto size = static_cast<std::size_t>(normal_.map().camera_size);
  const int rows = pattern_.num_rows();
  std::size_t first = 0;
  for (int begin = 0; begin < rows;) {
    RowTask task{.begin = begin, .end = begin, .reach = begin, .first = first};
    long blocks = 0;
    while (task.end < rows && blocks < blocks_per_task) {
      const long row_end = pattern_.row_begin[task.end + 1];
      blocks += row_end - pattern_.row_begin[task.end];
      task.reach = std::max(task.reach, pattern_.column[row_end - 1] + 1);
      ++task.end;
    }
    first += size * static_cast<std::size_t>(task.reach - task.begin);
    begin = task.end;
    tasks.push_back(task);
  }
  return tasks;
}

std::size_t BlockSparseSchur::numbers_of(const std::vector<RowTask>& tasks) const {
  if (tasks.empty()) return 0;
  const RowTask& last = tasks.back();
  return last.first + static_cast<std::size_t>(normal_.map().camera_size) *
                          static_cast<std::size_t>(last.reach - last.begin);
}

// As many as keep within the bytes, from what the pattern says alone.
std::vector<BlockSparseSchur::RowTask> BlockSparseSchur::choose_tasks() const {
  const double bytes = sizeof(float) * static_cast<double>(area() * pattern_.num_blocks());
  for (int count = kMostTasks;; count /= 2) {
    std::vector<RowTask> tasks =
        cut_rows(std::max(pattern_.num_blocks() / count + 1, kLeastBlocksPerTask));
    const double of_sums = 2 * sizeof(double) * static_cast<double>(numbers_of(tasks));
    if (count == kFewestTasks || of_sums < kMostOfSums * bytes) return tasks;
  }
}

void BlockSparseSchur::form(CameraBlockDiagonal& diagonal) {
  schur_rows_.begin();
  for (int round = 0; round < schur_rows_.num_rounds(); ++round) {
    schur_rows_.exchange(round);
    const std::span<const int> rows = schur_rows_.rows_of_round(round);
    const auto at_once = static_cast<std::size_t>(schur_rows_.rows_at_once());
    const int tasks = ThreadPool::num_parts(std::ssize(rows), schur_rows_.rows_at_once());
    normal_.pool().parallel_for_worker(tasks, [&](int task, int worker) {
      const std::size_t first = at_once * task;
      form_rows(rows.subspan(first, std::min(at_once, rows.size() - first)), worker, diagonal);
    });
  }
  diagonal_ = diagonal.camera_block(0);
}

// Blocks of own cameras are whole; columns that cameras share are of several.
void BlockSparseSchur::gather(CameraBlockDiagonal& diagonal, std::vector<double>& rhs) const {
  diagonal.gather(rhs, normal_.map().has_shared_columns ? normal_.exchange() : this_process());
}

void BlockSparseSchur::form_rows(std::span<const int> cameras,
                                 int worker,
                                 CameraBlockDiagonal& diagonal) {
  AlignedVector<double>* rows = rows_.data() + worker * schur_rows_.rows_at_once();
  std::array<SchurRows::Place, SchurRows::kMostRows> places;
  for (std::size_t k = 0; k < cameras.size(); ++k) {
    const int i = cameras[k];
    rows[k].resize(static_cast<std::size_t>(area()) * columns_behind(i).size());
    places[k] = {diagonal.camera_block(i), rows[k].data(), diagonal.camera_rhs(i)};
  }
  schur_rows_.form(cameras, {places.data(), cameras.size()}, worker);
  for (std::size_t k = 0; k < cameras.size(); ++k) round_row(cameras[k], rows[k].data());
}

void BlockSparseSchur::round_row(int i, const double* row) {
  float* rounded = blocks_.data() + first_of_row(i);
  for (const int j : columns_behind(i)) {
    kernels_.round(row,
                   schur_rows_.grid().inverse_of_camera(i),
                   schur_rows_.grid().inverse_of_camera(j),
                   rounded);
    row += area();
    rounded += area();
  }
}

template <class Number>
void BlockSparseSchur::multiply(const std::vector<double>& x, std::vector<Number>& out) {
  expand(x);
  // No entry of a block is larger than 1.
  const int size = normal_.map().camera_size;
  middle_ = middle_of_sum(normal_.exchange().max(largest_of_x()), size * most_terms_);
  normal_.pool().parallel_for(static_cast<int>(tasks_.size()),
                              [&](int task) { multiply_rows(tasks_[task]); });
  const int rows = pattern_.num_rows();
  normal_.pool().parallel_for_parts(rows, cameras_per_task(rows), [&](long i, long end) {
    add_up(static_cast<int>(i), static_cast<int>(end));
  });
  normal_.for_each_camera_in_order([&](int i, Columns columns) {
    if (touched_[i]) normal_.fold(out_.data() + size * i, i, columns, out.data());
  });
}

void BlockSparseSchur::expand(const std::vector<double>& x) {
  const ParameterMap& map = normal_.map();
  const long size = map.camera_size;
  for_each_camera(normal_.pool(), pattern_.num_rows(), [&](int i) {
    if (!touched_[i]) return;
    double* of_camera = x_.data() + size * i;
    map.expand(x.data(), i, of_camera);
    for (long k = 0; k < size; ++k) of_camera[k] *= powers(i)[k];
  });
}

double BlockSparseSchur::largest_of_x() const {
  const auto size = static_cast<long>(x_.size());
  const long part = cameras_per_task(pattern_.num_rows()) * normal_.map().camera_size;
  return normal_.pool().max(ThreadPool::num_parts(size, part), [&](int task) {
    double largest = 0.0;
    for (long k = task * part; k < std::min((task + 1) * part, size); ++k)
      largest = std::max(largest, std::abs(x_[k]));
    return largest;
  });
}

void BlockSparseSchur::multiply_rows(const RowTask& task) {
  double* sums = sums_.data() + task.first;
  std::fill_n(sums, static_cast<long>(normal_.map().camera_size) * (task.reach - task.begin), 0.0);
  for (int i = task.begin; i < task.end; ++i) {
    const std::span<const int> columns = columns_behind(i);
    kernels_.add_row(static_cast<int>(columns.size()),
                     blocks_of_row(i),
                     columns.data(),
                     i,
                     task.begin,
                     x_.data(),
                     middle_,
                     sums);
  }
}

// The diagonal blocks, and the sums of the tasks, for the cameras [begin, end).
void BlockSparseSchur::add_up(int begin, int end) {
  const long size = normal_.map().camera_size;
  std::fill(out_.begin() + size * begin, out_.begin() + size * end, 0.0);
  for (const RowTask& task : tasks_) {
    const long from = std::max(begin, task.begin), to = std::min(end, task.reach);
    const double* sums = sums_.data() + task.first + size * (from - task.begin);
    for (long k = 0; k < size * (to - from); ++k) out_[size * from + k] += sums[k];
  }
  for (int i = begin; i < end; ++i) {
    if (touched_[i]) finish_camera(i);
  }
}

// Adds the diagonal block on the grid, and takes the powers off.
void BlockSparseSchur::finish_camera(int i) {
  const long size = normal_.map().camera_size;
  const double* inverse = schur_rows_.grid().inverse_of_camera(i);
  double x[kMaxCameraSize] = {}, product[kMaxCameraSize] = {};
  for (long k = 0; k < size; ++k) x[k] = x_[size * i + k] * inverse[k];
  kernels_.add_block(diagonal_block(i), x, product);
  double* out = out_.data() + size * i;
  for (long k = 0; k < size; ++k)
    out[k] = (out[k] + ((product[k] * inverse[k] + middle_) - middle_)) * powers(i)[k];
}

namespace {

std::vector<char> own_cameras(const NormalEquations& normal, const CameraPartition& partition) {
  std::vector<char> is_own(normal.graph().num_cameras);
  for (int i = 0; i < normal.graph().num_cameras; ++i) is_own[i] = partition.is_own(i);
  return is_own;
}

// With those that own ones are related to.
std::vector<char> touched_cameras(const NormalEquations& normal,
                                  const SchurOperator& schur,
                                  const std::vector<char>& is_own) {
  std::vector<char> touched = schur.touched_cameras();
  for (int i = 0; i < normal.graph().num_cameras; ++i) {
    if (!is_own[i]) continue;
    touched[i] = 1;
    normal.camera_terms().for_each_block(i, [&](int j, const double*) { touched[j] = 1; });
  }
  return touched;
}

}  // namespace

DistributedProduct::DistributedProduct(const NormalEquations& normal,
                                       SchurOperator& schur,
                                       const CameraPartition& partition)
    : normal_(normal),
      schur_(schur),
      is_own_(own_cameras(normal, partition)),
      columns_(normal, partition, touched_cameras(normal, schur, is_own_)) {}

void DistributedProduct::apply(const Vector& diagonal, const Vector& x, Vector& out) {
  if (schur_.is_rounded() && normal_.camera_terms().empty()) {
    multiply(x, whole_, out);
  } else {
    multiply(x, whole_sums_, out);
  }
  for (std::size_t k = 0; k < out.size(); ++k) out[k] += diagonal[k] * x[k];
}

template <class Number>
void DistributedProduct::multiply(const Vector& x, std::vector<Number>& whole, Vector& out) {
  const Vector& whole_x = columns_.with_ghosts(x);
  whole.assign(whole_x.size(), Number());
  schur_.add_product(whole_x, whole);
  if constexpr (std::is_same_v<Number, CompensatedSum>)
    normal_.camera_terms().add_product(normal_.map(), is_own_, whole_x, whole);
  columns_.sum_ghosts(whole, out);
}

}  // namespace sfmcpp::linear

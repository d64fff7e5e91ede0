#include <algorithm>

#include "schur_operator.hpp"
#include "sfmcpp/core/isa.hpp"
#include "sfmcpp/linear/block_product_isa.hpp"

namespace sfmcpp::linear {

BlockProductKernels block_product_kernels(int camera_size) {
  return SFMCPP_FOR_ACTIVE_ISA(product_kernels_for(camera_size));
}

namespace {

// Rows of the upper half that one task multiplies, and the cameras that they reach.
struct RowTask {
  int begin;
  int end;
  int reach;          // one behind the last camera
  std::size_t first;  // of its sums, those of camera `begin`, in numbers
};

constexpr int kMostTasks = 64;
constexpr long kLeastBlocksPerTask = 4096;
// The sums of tasks that reach over each other are written and read besides the blocks: no more
// than this share of their bytes.
constexpr double kMostOfSums = 0.15;

std::vector<RowTask> cut_rows(const CameraPattern& pattern, long blocks_per_task, int size) {
  std::vector<RowTask> tasks;
  const int rows = pattern.num_rows();
  std::size_t first = 0;
  for (int begin = 0; begin < rows;) {
    RowTask task{.begin = begin, .end = begin, .reach = begin, .first = first};
    long blocks = 0;
    while (task.end < rows && blocks < blocks_per_task) {
      const long row_end = pattern.row_begin[task.end + 1];
      blocks += row_end - pattern.row_begin[task.end];
      task.reach = std::max(task.reach, pattern.column[row_end - 1] + 1);
      ++task.end;
    }
    first += static_cast<std::size_t>(size) * static_cast<std::size_t>(task.reach - task.begin);
    begin = task.end;
    tasks.push_back(task);
  }
  return tasks;
}

std::size_t numbers_of(const std::vector<RowTask>& tasks, int size) {
  if (tasks.empty()) return 0;
  const RowTask& last = tasks.back();
  return last.first + static_cast<std::size_t>(size) * (last.reach - last.begin);
}

// As many as keep within the bytes, from what the pattern says alone.
std::vector<RowTask> choose_tasks(const CameraPattern& pattern, int size) {
  const double bytes = 4.0 * size * size * static_cast<double>(pattern.num_blocks());
  for (int count = kMostTasks;; count /= 2) {
    const long blocks = std::max(pattern.num_blocks() / count + 1, kLeastBlocksPerTask);
    std::vector<RowTask> tasks = cut_rows(pattern, blocks, size);
    const double of_sums = 16.0 * static_cast<double>(numbers_of(tasks, size));
    if (count <= 4 || of_sums < kMostOfSums * bytes) return tasks;
  }
}

// The blocks above the diagonal in single precision, those on it in double precision. A row is
// formed in double precision and rounded when it is complete.
class BlockSparseSchur final : public SchurOperator {
 public:
  BlockSparseSchur(const NormalEquations& normal,
                   PointElimination& elimination,
                   std::shared_ptr<const ReducedStructure> structure)
      : normal_(normal),
        elimination_(elimination),
        structure_(std::move(structure)),
        pattern_(structure_->pattern),
        kernels_(block_product_kernels(normal.map().camera_size)),
        tasks_(choose_tasks(pattern_, normal.map().camera_size)) {
    const auto size = static_cast<std::size_t>(normal.map().camera_size);
    const auto cameras = static_cast<std::size_t>(normal.graph().num_cameras);
    blocks_.resize(size * size * (static_cast<std::size_t>(pattern_.num_blocks()) - cameras));
    sums_.resize(numbers_of(tasks_, normal.map().camera_size));
    x_.resize(size * cameras);
    out_.resize(size * cameras);
    scratch_.resize(normal.pool().num_threads());
    for (Scratch& scratch : scratch_) scratch.block_of_camera.resize(cameras);
  }

  bool is_rounded() const override { return true; }

  void assemble(CameraBlockDiagonal& diagonal, std::vector<double>& rhs) override {
    normal_.pool().parallel_for_worker(pattern_.num_rows(), [&](int i, int worker) {
      form_row(i, scratch_[worker], diagonal);
    });
    diagonal_ = diagonal.camera_block(0);
    diagonal.gather(rhs);
  }

  void add_product(const std::vector<double>& x, std::vector<double>& out) override {
    const long size = normal_.map().camera_size;
    normal_.pool().parallel_for_parts(pattern_.num_rows(), kCamerasPerTask, [&](long i, long end) {
      for (; i < end; ++i) normal_.map().expand(x.data(), static_cast<int>(i), &x_[size * i]);
    });
    normal_.pool().parallel_for(static_cast<int>(tasks_.size()),
                                [&](int task) { multiply_rows(tasks_[task]); });
    normal_.pool().parallel_for_parts(pattern_.num_rows(), kCamerasPerTask, [&](long i, long end) {
      add_up(static_cast<int>(i), static_cast<int>(end));
    });
    normal_.for_each_camera_in_order([&](int i, Columns columns) {
      normal_.fold(out_.data() + size * i, i, columns, out.data());
    });
  }

 private:
  struct Scratch {
    AlignedVector<double> row;
    std::vector<int> block_of_camera;
  };

  float* blocks_of_row(int i) {
    const long area = static_cast<long>(normal_.map().camera_size) * normal_.map().camera_size;
    return blocks_.data() + area * (pattern_.row_begin[i] - i);
  }

  void form_row(int i, Scratch& scratch, CameraBlockDiagonal& diagonal) {
    const ObservationGraph& graph = normal_.graph();
    const long area = static_cast<long>(normal_.map().camera_size) * normal_.map().camera_size;
    const long first = pattern_.row_begin[i] + 1, end = pattern_.row_begin[i + 1];
    for (long k = first; k < end; ++k)
      scratch.block_of_camera[pattern_.column[k]] = static_cast<int>(k - first);
    scratch.row.assign(static_cast<std::size_t>((end - first) * area), 0.0);
    normal_.kernels().schur_row({.graph = graph.view(),
                                 .begin = graph.camera_begin[i],
                                 .end = graph.camera_begin[i + 1],
                                 .jacobian = normal_.jacobian(),
                                 .factors = elimination_.factors(),
                                 .block_of_camera = scratch.block_of_camera.data(),
                                 .diagonal = diagonal.camera_block(i),
                                 .blocks = scratch.row.data(),
                                 .rhs = diagonal.camera_rhs(i)});
    float* rounded = blocks_of_row(i);
    for (long k = 0; k < end - first; ++k)
      kernels_.round(scratch.row.data() + area * k, rounded + area * k);
  }

  void multiply_rows(const RowTask& task) {
    double* sums = sums_.data() + task.first;
    std::fill_n(sums, static_cast<long>(normal_.map().camera_size) * (task.reach - task.begin), 0.0);
    for (int i = task.begin; i < task.end; ++i) {
      const long first = pattern_.row_begin[i] + 1;
      kernels_.add_row(static_cast<int>(pattern_.row_begin[i + 1] - first),
                       blocks_of_row(i),
                       pattern_.column.data() + first,
                       i,
                       task.begin,
                       x_.data(),
                       sums);
    }
  }

  // The diagonal blocks, and the sums of the tasks in their order, for the cameras [begin, end).
  void add_up(int begin, int end) {
    const long size = normal_.map().camera_size;
    std::fill(out_.begin() + size * begin, out_.begin() + size * end, 0.0);
    for (long i = begin; i < end; ++i)
      kernels_.add_block(diagonal_ + size * size * i, &x_[size * i], &out_[size * i]);
    for (const RowTask& task : tasks_) {
      const long from = std::max(begin, task.begin), to = std::min(end, task.reach);
      const double* sums = sums_.data() + task.first + size * (from - task.begin);
      for (long k = 0; k < size * (to - from); ++k) out_[size * from + k] += sums[k];
    }
  }

  const NormalEquations& normal_;
  PointElimination& elimination_;
  std::shared_ptr<const ReducedStructure> structure_;
  const CameraPattern& pattern_;
  BlockProductKernels kernels_;
  std::vector<RowTask> tasks_;
  AlignedVector<float> blocks_;         // above the diagonal, row after row
  const double* diagonal_ = nullptr;    // of every camera, panel layout
  AlignedVector<double> sums_;          // of the tasks
  AlignedVector<double> x_, out_;       // camera blocks
  std::vector<Scratch> scratch_;        // of each worker
};

}  // namespace

std::unique_ptr<SchurOperator> make_block_sparse_schur(
    const NormalEquations& normal,
    PointElimination& elimination,
    std::shared_ptr<const ReducedStructure> structure) {
  return std::make_unique<BlockSparseSchur>(normal, elimination, std::move(structure));
}

}  // namespace sfmcpp::linear

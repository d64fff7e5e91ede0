#include "block_sparse_schur.hpp"

#include <algorithm>

#include "sfmcpp/core/isa.hpp"
#include "sfmcpp/linear/block_product_isa.hpp"

namespace sfmcpp::linear {
namespace {

constexpr int kMostTasks = 64, kFewestTasks = 4;
constexpr long kLeastBlocksPerTask = 4096;
// The sums of tasks that reach over each other are written and read besides the blocks: no more
// than this share of their bytes.
constexpr double kMostOfSums = 0.15;

// Those of own rows.
std::vector<char> cameras_of(const CameraPattern& pattern, const CameraShares& shares) {
  std::vector<char> result(pattern.num_rows(), 0);
  for (int i = 0; i < pattern.num_rows(); ++i) {
    if (!shares.is_own(i)) continue;
    for (long k = pattern.row_begin[i]; k < pattern.row_begin[i + 1]; ++k)
      result[pattern.column[k]] = 1;
  }
  return result;
}

}  // namespace

BlockProductKernels block_product_kernels(int camera_size) {
  return SFMCPP_FOR_ACTIVE_ISA(product_kernels_for(camera_size));
}

BlockSparseSchur::BlockSparseSchur(const NormalEquations& normal,
                                   PointElimination& elimination,
                                   const CameraShares& shares,
                                   const std::shared_ptr<const ReducedStructure>& structure)
    : normal_(normal),
      schur_rows_(normal, elimination, shares, structure),
      pattern_(schur_rows_.pattern()),
      touched_(cameras_of(pattern_, shares)),
      kernels_(block_product_kernels(normal.map().camera_size)),
      tasks_(choose_tasks()) {
  const auto size = static_cast<std::size_t>(normal.map().camera_size);
  const auto cameras = static_cast<std::size_t>(normal.graph().num_cameras);
  blocks_.resize(size * size * (static_cast<std::size_t>(pattern_.num_blocks()) - cameras));
  sums_.resize(numbers_of(tasks_));
  x_.resize(size * cameras);
  out_.resize(size * cameras);
  rows_.resize(normal.pool().num_threads());
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

void BlockSparseSchur::assemble(CameraBlockDiagonal& diagonal, std::vector<double>& rhs) {
  schur_rows_.exchange();
  normal_.pool().parallel_for_worker(pattern_.num_rows(),
                                     [&](int i, int worker) { form_row(i, worker, diagonal); });
  diagonal_ = diagonal.camera_block(0);
  // Of own cameras they are whole; columns that cameras share are of several.
  diagonal.gather(rhs, normal_.map().has_shared_columns ? normal_.exchange() : this_process());
}

void BlockSparseSchur::form_row(int i, int worker, CameraBlockDiagonal& diagonal) {
  const auto num_blocks = static_cast<long>(columns_of_row(i).size());
  AlignedVector<double>& row = rows_[worker];
  row.resize(static_cast<std::size_t>(area() * num_blocks));
  schur_rows_.form(i, worker, diagonal.camera_block(i), row.data(), diagonal.camera_rhs(i));
  float* rounded = blocks_.data() + (blocks_of_row(i) - blocks_.data());
  for (long k = 0; k < num_blocks; ++k)
    kernels_.round(row.data() + area() * k, rounded + area() * k);
}

void BlockSparseSchur::add_product(const std::vector<double>& x, std::vector<double>& out) {
  const ParameterMap& map = normal_.map();
  const long size = map.camera_size;
  normal_.pool().parallel_for_parts(pattern_.num_rows(), kCamerasPerTask, [&](long i, long end) {
    for (; i < end; ++i) {
      if (touched_[i]) map.expand(x.data(), static_cast<int>(i), x_.data() + size * i);
    }
  });
  normal_.pool().parallel_for(static_cast<int>(tasks_.size()),
                              [&](int task) { multiply_rows(tasks_[task]); });
  normal_.pool().parallel_for_parts(pattern_.num_rows(), kCamerasPerTask, [&](long i, long end) {
    add_up(static_cast<int>(i), static_cast<int>(end));
  });
  normal_.for_each_camera_in_order([&](int i, Columns columns) {
    if (touched_[i]) normal_.fold(out_.data() + size * i, i, columns, out.data());
  });
}

void BlockSparseSchur::multiply_rows(const RowTask& task) {
  double* sums = sums_.data() + task.first;
  std::fill_n(sums, static_cast<long>(normal_.map().camera_size) * (task.reach - task.begin), 0.0);
  for (int i = task.begin; i < task.end; ++i) {
    const std::span<const int> columns = columns_of_row(i);
    kernels_.add_row(static_cast<int>(columns.size()),
                     blocks_of_row(i),
                     columns.data(),
                     i,
                     task.begin,
                     x_.data(),
                     sums);
  }
}

// The diagonal blocks, and the sums of the tasks in their order, for the cameras [begin, end).
void BlockSparseSchur::add_up(int begin, int end) {
  const long size = normal_.map().camera_size;
  std::fill(out_.begin() + size * begin, out_.begin() + size * end, 0.0);
  for (int i = begin; i < end; ++i) {
    if (touched_[i])
      kernels_.add_block(diagonal_block(i), x_.data() + size * i, out_.data() + size * i);
  }
  for (const RowTask& task : tasks_) {
    const long from = std::max(begin, task.begin), to = std::min(end, task.reach);
    const double* sums = sums_.data() + task.first + size * (from - task.begin);
    for (long k = 0; k < size * (to - from); ++k) out_[size * from + k] += sums[k];
  }
}

}  // namespace sfmcpp::linear

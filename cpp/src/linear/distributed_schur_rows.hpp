// Rows of S on the ranks that their cameras belong to: what the points of a rank add to rows of
// others is sent to these in double precision, block by block, and a row is rounded only when it is
// complete. Sums are taken on a grid (sum_grid.hpp): S does not depend on how points are
// distributed.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "rank_partition.hpp"
#include "sfmcpp/linear/reduced_structure.hpp"
#include "sfmcpp/linear/schur_rows.hpp"

namespace sfmcpp::linear {

class DistributedSchurRows {
 public:
  // `structure` is of all ranks. By all ranks, as are those below.
  DistributedSchurRows(const NormalEquations& normal,
                       const PointElimination& elimination,
                       const CameraPartition& partition,
                       const std::shared_ptr<const ReducedStructure>& structure);

  const SumGrid& grid() const { return grid_; }
  // The rows of this rank's cameras; of others the diagonal block, which is zero.
  const CameraPattern& pattern() const { return own_->pattern; }
  // Rows are sent and formed in rounds, so that what is on its way is small.
  int num_rounds() const { return static_cast<int>(rounds_.size()); }
  const std::vector<int>& rows_of_round(int round) const { return rounds_[round].rows; }
  // Numbers that other ranks send for the rows of a round.
  long received_in_round(int round) const { return rounds_[round].num_received; }
  // Before the first round: scales the grid for the Jacobian that the normal equations hold.
  void begin() { grid_.set(normal_); }
  // Sends what the points here add to the rows of others in this round, for the factors that the
  // elimination holds.
  void exchange(int round);
  // As SchurRows has them; one where parts of rows come from other ranks.
  int rows_at_once() const { return partition_.are_all_own() ? rows_.rows_at_once() : 1; }
  // As SchurRows::form, for the rows of `pattern` in the round that was exchanged last; zero for
  // cameras of others.
  void form(std::span<const int> cameras, std::span<const SchurRows::Place> places, int worker);

 private:
  // A part of a row for another rank.
  struct Sent {
    int camera;
    long first;  // number of what is sent in its round
  };
  // One that another rank has formed.
  struct Received {
    std::vector<int> columns;  // of its blocks behind the diagonal one
    long first;                // number of what is received in its round
  };
  struct Round {
    std::vector<int> rows;  // of all ranks, ascending
    std::vector<Sent> sent;
    std::vector<int> sent_counts, received_counts;  // of each rank
    long num_sent = 0, num_received = 0;
  };
  long size() const { return normal_.map().camera_size; }
  // Numbers of a part of a row: the diagonal block, the right-hand side with what is rounded off,
  // other blocks.
  long numbers_of(std::size_t blocks) const {
    return size() * (size() + 2) + size() * size() * static_cast<long>(blocks);
  }
  void form_with_received(int i, const SchurRows::Place& place, int worker);
  void form_here(int i, const SchurRows::Place& place, int worker) {
    rows_.form({&i, 1}, {&place, 1}, worker);
  }
  // Whether points here add to the row of another rank.
  bool is_sent(int camera) const;
  std::vector<double> numbers_on_their_way() const;
  int choose_rounds(const std::vector<double>& numbers) const;
  void divide_into_rounds();
  void send_headers();
  void read_headers(const std::vector<double>& headers, const std::vector<int>& counts);

  const NormalEquations& normal_;
  const CameraPartition& partition_;
  std::shared_ptr<const ReducedStructure> here_, own_;  // of the points here; of own rows
  SumGrid grid_;
  SchurRows rows_;
  std::vector<Round> rounds_;
  std::vector<int> round_of_row_;
  std::vector<std::vector<Received>> received_rows_;  // of each camera, in the order of the ranks
  AlignedVector<double> sent_, received_;             // in the last round
  std::vector<std::vector<int>> numbers_;     // of each worker: number of a camera's block in a row
  std::vector<AlignedVector<double>> parts_;  // likewise: blocks of a row from the points here
};

}  // namespace sfmcpp::linear

// Where the rows below a supernode lie in the panels of the supernodes above: what it takes from
// them is added there.
#pragma once

#include <span>
#include <vector>

#include "sfmcpp/linear/cholesky_kernels.hpp"
#include "sfmcpp/linear/supernodes.hpp"

namespace sfmcpp::linear {

// What several subtrees take from the supernodes above, the lower triangle of a square matrix:
// columns in groups of kStrip that begin with the strip of their diagonal.
class UpdateTriangle {
 public:
  UpdateTriangle() = default;
  explicit UpdateTriangle(int size);

  std::int64_t num_entries() const { return num_entries_; }
  int padded_size() const { return padded_; }
  // Such that row r of a column is `r` further: rows above the strip of the diagonal there are
  // none.
  std::int64_t column(int c) const {
    const std::int64_t group = c / kStrip;
    return kStrip * (group * padded_ - kStrip * group * (group - 1) / 2) +
           (c - kStrip * group) * (padded_ - kStrip * group) - kStrip * group;
  }

 private:
  int padded_ = 0;
  std::int64_t num_entries_ = 0;
};

inline constexpr int kOutside = -1;

// The columns [begin, end) of an update belong to one supernode; the runs give the place of the
// update's rows, from `begin` on, among the rows of its panel (the first of these are its columns).
struct UpdateTarget {
  int supernode;  // or kOutside: the triangle of the subtrees
  int begin;
  int end;
  int first_run;
  int num_runs;
};

struct UpdateMap {
  std::vector<UpdateTarget> targets;
  std::vector<RowRun> runs;

  void clear() {
    targets.clear();
    runs.clear();
  }
};

// `rows`: places, `offsets`: their first rows in an update of `height` rows. What lies above
// `subtrees` goes to their triangle; null: there is none.
void make_update_map(const Supernodes& supernodes,
                     std::span<const int> rows,
                     std::span<const int> offsets,
                     int height,
                     const Subtrees* subtrees,
                     UpdateMap& map);

}  // namespace sfmcpp::linear

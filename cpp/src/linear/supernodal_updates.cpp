#include <algorithm>

#include "sfmcpp/linear/supernodal_cholesky.hpp"

namespace sfmcpp::linear {
namespace {

// The end of a range that `value` does not exceed, by steps that double: near the begin mostly.
const int* advance_to(const int* begin, const int* end, int value) {
  std::ptrdiff_t step = 1;
  while (step < end - begin && begin[step] < value) step *= 2;
  return std::lower_bound(begin + step / 2, std::min(begin + step + 1, end), value);
}

// One update under way: its places from `at` on.
class Mapper {
 public:
  Mapper(const Supernodes& s,
         std::span<const int> rows,
         std::span<const int> offsets,
         int height,
         UpdateMap& map)
      : s_(s), rows_(rows), offsets_(offsets), height_(height), map_(map) {}

  void add_target(int supernode, std::size_t from, std::size_t to) {
    map_.targets.push_back({.supernode = supernode,
                            .begin = offsets_[from],
                            .end = end_of(to),
                            .first_run = static_cast<int>(map_.runs.size()),
                            .num_runs = 0});
  }
  void finish_target() {
    map_.targets.back().num_runs =
        static_cast<int>(map_.runs.size()) - map_.targets.back().first_run;
  }

  void add_own_columns(int supernode, std::size_t from, std::size_t to) {
    for (std::size_t k = from; k < to; ++k)
      add_run(k, s_.first_column[rows_[k]] - s_.columns_begin(supernode));
  }
  // The places from `from` on are among `rows`.
  void add_rows(std::size_t from,
                std::span<const int> rows,
                std::span<const int> offsets,
                int first) {
    const int* at = rows.data();
    for (std::size_t k = from; k < rows_.size(); ++k) {
      at = advance_to(at, rows.data() + rows.size(), rows_[k]);
      add_run(k, first + offsets[at - rows.data()]);
    }
  }

 private:
  int end_of(std::size_t k) const { return k < rows_.size() ? offsets_[k] : height_; }

  void add_run(std::size_t k, int target) {
    const int source = offsets_[k], length = end_of(k + 1) - source;
    if (static_cast<int>(map_.runs.size()) > map_.targets.back().first_run) {
      RowRun& last = map_.runs.back();
      if (last.target + last.length == target) {
        last.length += length;
        return;
      }
    }
    map_.runs.push_back({source, target, length});
  }

  const Supernodes& s_;
  std::span<const int> rows_;
  std::span<const int> offsets_;
  int height_;
  UpdateMap& map_;
};

}  // namespace

UpdateTriangle::UpdateTriangle(int size) : padded_(round_up(size, kStrip)) {
  const std::int64_t groups = padded_ / kStrip;
  num_entries_ = kStrip * kStrip * (groups * (groups + 1) / 2);
}

void make_update_map(const Supernodes& supernodes,
                     std::span<const int> rows,
                     std::span<const int> offsets,
                     int height,
                     const Subtrees* subtrees,
                     UpdateMap& map) {
  map.clear();
  Mapper mapper(supernodes, rows, offsets, height, map);
  const int last = subtrees == nullptr ? supernodes.count() - 1 : subtrees->last;
  for (std::size_t from = 0, to; from < rows.size(); from = to) {
    const int target = supernodes.of_place[rows[from]];
    if (target > last) {
      mapper.add_target(kOutside, from, rows.size());
      mapper.add_rows(from, subtrees->rows, subtrees->row_offset, 0);
      mapper.finish_target();
      return;
    }
    const int end = supernodes.begin[target + 1];
    to = std::lower_bound(rows.begin() + static_cast<std::ptrdiff_t>(from), rows.end(), end) -
         rows.begin();
    mapper.add_target(target, from, to);
    mapper.add_own_columns(target, from, to);
    mapper.add_rows(to,
                    supernodes.rows_of(target),
                    supernodes.offsets_of(target),
                    supernodes.panel[target].top);
    mapper.finish_target();
  }
}

}  // namespace sfmcpp::linear

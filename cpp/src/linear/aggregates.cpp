#include "aggregates.hpp"

#include <algorithm>
#include <numeric>

namespace sfmcpp::linear {
namespace {

constexpr int kNoAggregate = -1;

std::vector<double> common_points(const ObservationGraph& graph,
                                  const CameraPattern& pattern,
                                  ThreadPool& pool) {
  std::vector<double> common(static_cast<std::size_t>(pattern.num_blocks()), 0.0);
  std::vector<std::vector<long>> block_of(pool.num_threads(), std::vector<long>(graph.num_cameras));
  pool.parallel_for_worker(graph.num_cameras, [&](int i, int worker) {
    std::vector<long>& block = block_of[worker];
    for (long k = pattern.row_begin[i]; k < pattern.row_begin[i + 1]; ++k)
      block[pattern.column[k]] = k;
    for (int a = graph.camera_begin[i]; a < graph.camera_begin[i + 1]; ++a) {
      const int end = graph.point_begin[graph.point[a] + 1];
      for (int position = graph.rank[a] + 1; position < end; ++position)
        common[block[graph.camera[graph.of_point[position]]]] += 1.0;
    }
  });
  return common;
}

class Grower {
 public:
  Grower(const CameraNeighbours& neighbours, int target)
      : neighbours_(neighbours),
        target_(target),
        of_camera_(neighbours.begin.size() - 1, kNoAggregate),
        pull_(of_camera_.size(), 0.0F) {}

  std::vector<int> grow() {
    for (int seed = 0; seed < num_cameras(); ++seed) {
      if (of_camera_[seed] == kNoAggregate) grow_from(seed);
    }
    return std::move(of_camera_);
  }

 private:
  int num_cameras() const { return static_cast<int>(of_camera_.size()); }

  void grow_from(int seed) {
    std::vector<int> members, candidates{seed};
    while (!candidates.empty() && static_cast<int>(members.size()) < target_) {
      const auto best = std::max_element(candidates.begin(), candidates.end(), [&](int a, int b) {
        return pull_[a] != pull_[b] ? pull_[a] < pull_[b] : a > b;
      });
      const int camera = *best;
      *best = candidates.back();
      candidates.pop_back();
      members.push_back(camera);
      of_camera_[camera] = count_;
      for_each_neighbour(camera, [&](int other, float common) {
        if (of_camera_[other] != kNoAggregate || common == 0.0F) return;
        if (pull_[other] == 0.0F) candidates.push_back(other);
        pull_[other] += common;
      });
    }
    for (int camera : candidates) pull_[camera] = 0.0F;
    const bool small = 3 * static_cast<int>(members.size()) < target_;
    const int neighbour = small ? strongest(members) : kNoAggregate;
    if (neighbour == kNoAggregate) {
      ++count_;
    } else {
      for (int camera : members) of_camera_[camera] = neighbour;
    }
  }

  // The earlier aggregate that sees most points with these cameras.
  int strongest(const std::vector<int>& members) const {
    std::vector<float> common(count_, 0.0F);
    for (int camera : members) {
      for_each_neighbour(camera, [&](int other, float points) {
        if (of_camera_[other] != kNoAggregate && of_camera_[other] < count_)
          common[of_camera_[other]] += points;
      });
    }
    const auto best = std::max_element(common.begin(), common.end());
    return best == common.end() || *best == 0.0F ? kNoAggregate
                                                 : static_cast<int>(best - common.begin());
  }

  template <class F>
  void for_each_neighbour(int camera, const F& f) const {
    for (long k = neighbours_.begin[camera]; k < neighbours_.begin[camera + 1]; ++k)
      f(neighbours_.camera[k], neighbours_.common[k]);
  }

  const CameraNeighbours& neighbours_;
  int target_;
  int count_ = 0;
  std::vector<int> of_camera_;
  std::vector<float> pull_;  // points in common with the aggregate that grows
};

}  // namespace

CameraNeighbours neighbours_of(const ObservationGraph& graph,
                               const CameraPattern& pattern,
                               ThreadPool& pool,
                               Exchange& exchange) {
  std::vector<double> common = common_points(graph, pattern, pool);
  exchange.sum(common);
  CameraNeighbours result;
  result.begin.assign(static_cast<std::size_t>(graph.num_cameras) + 1, 0);
  const auto for_each_pair = [&](const auto& f) {
    for (int i = 0; i < pattern.num_rows(); ++i) {
      for (long k = pattern.row_begin[i] + 1; k < pattern.row_begin[i + 1]; ++k)
        f(i, pattern.column[k], static_cast<float>(common[k]));
    }
  };
  for_each_pair([&](int i, int j, float) {
    ++result.begin[i + 1];
    ++result.begin[j + 1];
  });
  std::partial_sum(result.begin.begin(), result.begin.end(), result.begin.begin());
  result.camera.resize(static_cast<std::size_t>(result.begin.back()));
  result.common.resize(result.camera.size());
  std::vector<long> next(result.begin.begin(), result.begin.end() - 1);
  for_each_pair([&](int i, int j, float count) {
    result.camera[next[i]] = j;
    result.common[next[i]++] = count;
    result.camera[next[j]] = i;
    result.common[next[j]++] = count;
  });
  return result;
}

Aggregates aggregate_cameras(const CameraNeighbours& neighbours, int target) {
  Aggregates result;
  result.of_camera = Grower(neighbours, target).grow();
  const int count = 1 + *std::max_element(result.of_camera.begin(), result.of_camera.end());
  result.begin.assign(static_cast<std::size_t>(count) + 1, 0);
  for (int k : result.of_camera) ++result.begin[k + 1];
  std::partial_sum(result.begin.begin(), result.begin.end(), result.begin.begin());
  result.members.resize(result.of_camera.size());
  std::vector<int> next(result.begin.begin(), result.begin.end() - 1);
  for (int i = 0; i < neighbours.num_cameras(); ++i)
    result.members[next[result.of_camera[i]]++] = i;
  return result;
}

}  // namespace sfmcpp::linear

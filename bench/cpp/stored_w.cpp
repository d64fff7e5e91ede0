// The note's two variants (its §3) side by side, on the Jacobian of a problem that
// bench/stored_w.py wrote: W stored, S = U* − W V*⁻¹ Wᵀ, and W never stored, where the product of
// two observations of a point is J_aᵀ (G_a G_bᵀ) J_b of rank two. Same storage of S, same order of
// sums, same compiler flags, one thread; the Cholesky of S is left out, for it is the same.
//
//     sfmcpp_stored_w FILE stored|never REPEATS
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <limits>
#include <stdexcept>
#include <string_view>
#include <vector>

#include <Eigen/Cholesky>
#include <Eigen/Core>

namespace {

constexpr int kSize = 9;
constexpr double kDamping = 1e-4;

using CameraBlock = Eigen::Matrix<double, kSize, kSize>;
using CameraVector = Eigen::Matrix<double, kSize, 1>;
using PointBlock = Eigen::Matrix3d;
using JacobianOfCamera = Eigen::Matrix<double, 2, kSize>;
using JacobianOfPoint = Eigen::Matrix<double, 2, 3>;
using Coupling = Eigen::Matrix<double, 3, kSize>;  // W_aᵀ, its columns are the rows of W_a

// Blocks of S have columns of whole registers, so that what both variants spend most of their time
// with, S −= L R with L of two or three columns, is multiply-adds of registers in both.
constexpr int kLanes = 4;
constexpr int kRegisters = (kSize + kLanes - 1) / kLanes;
typedef double Lanes __attribute__((vector_size(kLanes * sizeof(double))));

struct Column {
  Lanes part[kRegisters] = {};

  void set(int row, double value) { part[row / kLanes][row % kLanes] = value; }
  double at(int row) const { return part[row / kLanes][row % kLanes]; }
};

struct PaddedBlock {
  Column column[kSize];
};

// S −= L R; R by columns.
template <int kDepth>
void subtract_product(const Column (&left)[kDepth], const double* right, PaddedBlock& s) {
  for (int c = 0; c < kSize; ++c)
    for (int k = 0; k < kDepth; ++k)
      for (int v = 0; v < kRegisters; ++v)
        s.column[c].part[v] -= left[k].part[v] * right[kDepth * c + k];
}

// Observations by camera and, within one, by point; and those of each point, by camera.
struct Input {
  std::int64_t cameras = 0, points = 0, observations = 0;
  std::vector<std::int32_t> camera, point;
  std::vector<JacobianOfCamera> of_camera;
  std::vector<JacobianOfPoint> of_point;
  std::vector<Eigen::Vector2d> residual;
  std::vector<std::int64_t> first_of_camera, first_of_point;
  std::vector<std::int32_t> by_point;
};

template <class T>
std::vector<T> read_values(std::ifstream& file, std::int64_t count) {
  std::vector<T> values(static_cast<std::size_t>(count));
  file.read(reinterpret_cast<char*>(values.data()),
            static_cast<std::streamsize>(values.size() * sizeof(T)));
  if (!file) throw std::runtime_error("the file is too short");
  return values;
}

std::vector<std::int64_t> starts(const std::vector<std::int32_t>& index, std::int64_t count) {
  std::vector<std::int64_t> first(static_cast<std::size_t>(count) + 1, 0);
  for (const auto k : index) ++first[static_cast<std::size_t>(k) + 1];
  for (std::size_t k = 1; k < first.size(); ++k) first[k] += first[k - 1];
  return first;
}

Input read(const char* path) {
  std::ifstream file(path, std::ios::binary);
  const auto counts = read_values<std::int64_t>(file, 3);
  Input in;
  in.cameras = counts[0], in.points = counts[1], in.observations = counts[2];
  in.camera = read_values<std::int32_t>(file, in.observations);
  in.point = read_values<std::int32_t>(file, in.observations);
  in.of_camera = read_values<JacobianOfCamera>(file, in.observations);
  in.of_point = read_values<JacobianOfPoint>(file, in.observations);
  in.residual = read_values<Eigen::Vector2d>(file, in.observations);
  in.first_of_camera = starts(in.camera, in.cameras);
  in.first_of_point = starts(in.point, in.points);
  in.by_point.resize(in.camera.size());
  auto next = in.first_of_point;
  for (std::size_t k = 0; k < in.point.size(); ++k)
    in.by_point[static_cast<std::size_t>(next[static_cast<std::size_t>(in.point[k])]++)] =
        static_cast<std::int32_t>(k);
  return in;
}

// The upper blocks of S by rows; `place` finds the block of a column in the row at work.
struct BlockRows {
  std::vector<std::int64_t> first;
  std::vector<std::int32_t> column;
  std::vector<PaddedBlock> block;
};

// Calls f(b) for the observations of the same point from a on, in the order of cameras.
template <class F>
void for_later(const Input& in, std::size_t a, const F& f) {
  const auto point = static_cast<std::size_t>(in.point[a]);
  for (auto k = in.first_of_point[point]; k < in.first_of_point[point + 1]; ++k) {
    const auto b = static_cast<std::size_t>(in.by_point[static_cast<std::size_t>(k)]);
    if (b >= a) f(b);
  }
}

BlockRows make_pattern(const Input& in) {
  BlockRows s;
  s.first.push_back(0);
  std::vector<std::int32_t> last(static_cast<std::size_t>(in.cameras), -1);
  for (std::int32_t i = 0; i < in.cameras; ++i) {
    const auto row = static_cast<std::size_t>(i);
    for (auto a = in.first_of_camera[row]; a < in.first_of_camera[row + 1]; ++a)
      for_later(in, static_cast<std::size_t>(a), [&](std::size_t b) {
        const auto j = static_cast<std::size_t>(in.camera[b]);
        if (last[j] == i) return;
        last[j] = i;
        s.column.push_back(in.camera[b]);
      });
    std::sort(s.column.begin() + s.first.back(), s.column.end());
    s.first.push_back(static_cast<std::int64_t>(s.column.size()));
  }
  s.block.resize(s.column.size());
  return s;
}

// U* in the diagonal blocks, b_c, V* factored (LLᵀ, as M = L⁻¹ of V*⁻¹ = MᵀM) and b_p: the same for
// both.
struct Sums {
  std::vector<CameraBlock> u;
  std::vector<CameraVector> b_camera;
  std::vector<PointBlock> m;
  std::vector<Eigen::Vector3d> b_point;
};

Sums make_sums(const Input& in) {
  Sums sums;
  sums.u.assign(static_cast<std::size_t>(in.cameras), CameraBlock::Zero());
  sums.b_camera.assign(sums.u.size(), CameraVector::Zero());
  sums.m.assign(static_cast<std::size_t>(in.points), PointBlock::Zero());
  sums.b_point.assign(sums.m.size(), Eigen::Vector3d::Zero());
  for (std::size_t k = 0; k < in.camera.size(); ++k) {
    const auto i = static_cast<std::size_t>(in.camera[k]),
               p = static_cast<std::size_t>(in.point[k]);
    sums.u[i].noalias() += in.of_camera[k].transpose() * in.of_camera[k];
    sums.b_camera[i].noalias() += in.of_camera[k].transpose() * in.residual[k];
    sums.m[p].noalias() += in.of_point[k].transpose() * in.of_point[k];
    sums.b_point[p].noalias() += in.of_point[k].transpose() * in.residual[k];
  }
  for (auto& u : sums.u) u.diagonal() *= 1.0 + kDamping;
  for (auto& v : sums.m) {
    v.diagonal() *= 1.0 + kDamping;
    const PointBlock l = v.llt().matrixL();
    v = l.triangularView<Eigen::Lower>().solve(PointBlock::Identity());
  }
  return sums;
}

// W_a of each observation, 27 numbers.
struct Stored {
  struct Left {
    Column column[3];  // W_a V*⁻¹: what the products of one observation with all later ones share
  };
  std::vector<Coupling> w;

  explicit Stored(const Input& in) : w(in.camera.size()) {}
  void prepare(const Input& in, const Sums&) {
    for (std::size_t k = 0; k < w.size(); ++k)
      w[k] = in.of_point[k].transpose().lazyProduct(in.of_camera[k]);
  }
  Left left(const Input& in, const Sums& sums, std::size_t a) const {
    const PointBlock& m = sums.m[static_cast<std::size_t>(in.point[a])];
    const Coupling product = (m.transpose() * m).lazyProduct(w[a]);
    Left left;
    for (int k = 0; k < 3; ++k)
      for (int row = 0; row < kSize; ++row) left.column[k].set(row, product(k, row));
    return left;
  }
  void subtract(const Input&, const Left& left, std::size_t, std::size_t b, PaddedBlock& s) const {
    subtract_product(left.column, w[b].data(), s);
  }
  Eigen::Vector3d seen_by_point(const Input&, std::size_t k, const CameraVector& step) const {
    return w[k].lazyProduct(step);
  }
  // The Jacobian can go once W is there.
  static double numbers_per_observation() { return kSize * 3.0; }
};

// The whitened G_a = Jp_a Mᵀ of each observation, in place of Jp_a, beside J_a: 24 numbers.
struct Never {
  struct Left {
    Column column[2];  // J_aᵀ
  };
  std::vector<JacobianOfPoint> g;

  explicit Never(const Input& in) : g(in.camera.size()) {}
  void prepare(const Input& in, const Sums& sums) {
    for (std::size_t k = 0; k < g.size(); ++k)
      g[k] = in.of_point[k].lazyProduct(sums.m[static_cast<std::size_t>(in.point[k])].transpose());
  }
  Left left(const Input& in, const Sums&, std::size_t a) const {
    Left left;
    for (int k = 0; k < 2; ++k)
      for (int row = 0; row < kSize; ++row) left.column[k].set(row, in.of_camera[a](k, row));
    return left;
  }
  void subtract(
      const Input& in, const Left& of_a, std::size_t a, std::size_t b, PaddedBlock& s) const {
    const Eigen::Matrix2d between = g[a].lazyProduct(g[b].transpose());
    Column left[2];
    for (int k = 0; k < 2; ++k)
      for (int v = 0; v < kRegisters; ++v)
        left[k].part[v] =
            of_a.column[0].part[v] * between(0, k) + of_a.column[1].part[v] * between(1, k);
    subtract_product(left, in.of_camera[b].data(), s);
  }
  Eigen::Vector3d seen_by_point(const Input& in, std::size_t k, const CameraVector& step) const {
    const Eigen::Vector2d in_image = in.of_camera[k].lazyProduct(step);
    return in.of_point[k].transpose().lazyProduct(in_image);
  }
  static double numbers_per_observation() { return 2.0 * kSize + 2.0 * 3; }
};

template <class Variant>
void form_schur(const Input& in, const Sums& sums, const Variant& variant, BlockRows& s) {
  std::vector<std::int64_t> place(static_cast<std::size_t>(in.cameras));
  for (std::size_t i = 0; i < sums.u.size(); ++i) {
    for (auto k = s.first[i]; k < s.first[i + 1]; ++k) {
      const auto slot = static_cast<std::size_t>(k);
      place[static_cast<std::size_t>(s.column[slot])] = k;
      s.block[slot] = PaddedBlock{};
    }
    PaddedBlock& diagonal = s.block[static_cast<std::size_t>(place[i])];
    for (int c = 0; c < kSize; ++c)
      for (int row = 0; row < kSize; ++row) diagonal.column[c].set(row, sums.u[i](row, c));
    for (auto a = in.first_of_camera[i]; a < in.first_of_camera[i + 1]; ++a) {
      const auto left = variant.left(in, sums, static_cast<std::size_t>(a));
      for_later(in, static_cast<std::size_t>(a), [&](std::size_t b) {
        const auto j = static_cast<std::size_t>(in.camera[b]);
        variant.subtract(
            in, left, static_cast<std::size_t>(a), b, s.block[static_cast<std::size_t>(place[j])]);
      });
    }
  }
}

// δp = V*⁻¹ (b_p − Wᵀ δc) for δc = b_c: any step does for a time, this one is at hand.
template <class Variant>
double substitute_back(const Input& in, const Sums& sums, const Variant& variant) {
  double squared = 0.0;
  for (std::size_t p = 0; p < sums.m.size(); ++p) {
    Eigen::Vector3d right = sums.b_point[p];
    for (auto k = in.first_of_point[p]; k < in.first_of_point[p + 1]; ++k) {
      const auto a = static_cast<std::size_t>(in.by_point[static_cast<std::size_t>(k)]);
      right -= variant.seen_by_point(in, a, sums.b_camera[static_cast<std::size_t>(in.camera[a])]);
    }
    squared += (sums.m[p].transpose() * (sums.m[p] * right)).squaredNorm();
  }
  return squared;
}

double milliseconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start)
      .count();
}

template <class Variant>
void measure(const Input& in, int repeats) {
  using Clock = std::chrono::steady_clock;
  const Sums sums = make_sums(in);
  BlockRows s = make_pattern(in);
  Variant variant(in);
  double prepare = std::numeric_limits<double>::infinity(), form = prepare, back = prepare;
  double squared_step = 0.0, squared_schur = 0.0;
  for (int k = 0; k < repeats; ++k) {
    auto start = Clock::now();
    variant.prepare(in, sums);
    prepare = std::min(prepare, milliseconds_since(start));
    start = Clock::now();
    form_schur(in, sums, variant, s);
    form = std::min(form, milliseconds_since(start));
    start = Clock::now();
    squared_step = substitute_back(in, sums, variant);
    back = std::min(back, milliseconds_since(start));
  }
  for (const PaddedBlock& block : s.block)
    for (const Column& column : block.column)
      for (int row = 0; row < kSize; ++row) squared_schur += column.at(row) * column.at(row);
  const double per_observation = Variant::numbers_per_observation() * sizeof(double);
  std::printf(
      "{\"prepare_ms\": %.4f, \"schur_ms\": %.4f, \"back_ms\": %.4f, \"bytes\": %.0f, "
      "\"blocks\": %zu, \"norm_of_s\": %.17g, \"norm_of_step\": %.17g}\n",
      prepare,
      form,
      back,
      per_observation * static_cast<double>(in.observations),
      s.block.size(),
      std::sqrt(squared_schur),
      std::sqrt(squared_step));
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 4) {
    std::fprintf(stderr, "usage: sfmcpp_stored_w FILE stored|never REPEATS\n");
    return EXIT_FAILURE;
  }
  try {
    const Input in = read(argv[1]);
    const int repeats = std::atoi(argv[3]);
    std::string_view(argv[2]) == "stored" ? measure<Stored>(in, repeats)
                                          : measure<Never>(in, repeats);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "sfmcpp_stored_w: %s\n", error.what());
    return EXIT_FAILURE;
  }
  return EXIT_SUCCESS;
}

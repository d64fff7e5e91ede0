#include "support/dense_reference.hpp"

#include <cmath>

#include "support/camera_dispatch.hpp"
#include "support/whitening_factor.hpp"

namespace sfmcpp::support {
namespace {

class DenseAssembler {
 public:
  DenseAssembler(const LinearizedProblem& linearized, const Loss& loss)
      : in_(linearized), loss_(loss) {
    number_columns();
  }

  DenseSystem assemble() {
    for (int k = 0; k < in_.problem.num_observations(); ++k) {
      visit_camera(in_.problem.camera_model, [&](auto camera) { add<decltype(camera)>(k); });
    }
    return std::move(out_);
  }

 private:
  void number_columns() {
    out_.camera_columns = in_.map.num_columns;
    int next = in_.map.num_columns;
    for (char free : in_.map.free_point) {
      out_.point_column.push_back(free ? next : -1);
      if (free) next += 3;
    }
    out_.jacobian.setZero(2 * in_.problem.num_observations(), next);
    out_.residual.setZero(2 * in_.problem.num_observations());
  }

  template <class Camera>
  void add(int k) {
    const ba::Problem& problem = in_.problem;
    const int i = problem.camera_index[k], p = problem.point_index[k];
    const int group = problem.intrinsics_index[i] * problem.num_intrinsics();
    LinearizedImagePoint<double, Camera::kTangent, Camera::kIntrinsics> lin{};
    Camera::linearize(in_.state.cameras.data() + kCameraStorage * i,
                      in_.state.intrinsics.data() + group,
                      in_.state.points.data() + static_cast<long>(Camera::kPointStorage) * p,
                      lin);
    const Eigen::Matrix2d factor = whitening_factor(problem, k);
    const Eigen::Vector2d r = factor * Eigen::Vector2d(problem.pixels[2 * k] - lin.image.u,
                                                       problem.pixels[2 * k + 1] - lin.image.v);
    const double weight = std::sqrt(loss_.derivative(r.squaredNorm()));
    out_.residual.segment<2>(2 * k) = weight * r;
    for (int row = 0; row < 2; ++row) add_row<Camera>(lin, row, 2 * k + row, i, p, 1.0);
    out_.jacobian.middleRows<2>(2 * k) =
        (weight * factor * out_.jacobian.middleRows<2>(2 * k)).eval();
  }

  template <class Camera, class Linearized>
  void add_row(const Linearized& lin, int row, int target, int i, int p, double weight) {
    const int* columns = in_.map.columns_of(i);
    for (int c = 0; c < Camera::kTangent; ++c) set(target, columns[c], weight * lin.camera[row][c]);
    for (std::size_t c = 0; c < in_.free_intrinsics.size(); ++c) {
      const double value = weight * lin.intrinsics[row][in_.free_intrinsics[c]];
      set(target, columns[Camera::kTangent + c], value);
    }
    if (out_.point_column[p] < 0) return;
    for (int c = 0; c < 3; ++c) set(target, out_.point_column[p] + c, weight * lin.point[row][c]);
  }

  void set(int row, int column, double value) {
    if (column >= 0) out_.jacobian(row, column) = value;
  }

  const LinearizedProblem& in_;
  Loss loss_;
  DenseSystem out_;
};

}  // namespace

DenseSystem make_dense_system(const LinearizedProblem& linearized, const Loss& loss) {
  return DenseAssembler(linearized, loss).assemble();
}

}  // namespace sfmcpp::support

#include <algorithm>

#include "schur_operator.hpp"

namespace sfmcpp::linear {
namespace {

// S x without S or W: with e = Jc x, S x = Jcᵀ (e − G Σ Gᵀ e), the sum over the observations of
// each point; and G Σ Gᵀ e = A t with t = Mᵀ Σ Gᵀ e. Memory is that of the Jacobian.
class ImplicitSchur final : public SchurOperator {
 public:
  ImplicitSchur(const NormalEquations& normal, PointElimination& elimination)
      : normal_(normal), elimination_(elimination) {}

  void assemble(CameraBlockDiagonal& diagonal, std::vector<double>& rhs) override {
    diagonal.assemble(elimination_.factors(), rhs);
  }
  bool is_rounded() const override { return false; }
  std::vector<char> touched_cameras() const override {
    std::vector<char> touched(normal_.graph().num_cameras);
    for (int i = 0; i < normal_.graph().num_cameras; ++i)
      touched[i] = normal_.graph().observations_of_camera(i) > 0;
    return touched;
  }

  void add_product(const std::vector<double>& x, std::vector<double>& out) override {
    const ObservationGraph& graph = normal_.graph();
    const long size = normal_.map().camera_size;
    shifts_.resize(3 * static_cast<std::size_t>(graph.num_points));
    chunk_sums_.resize(graph.chunks.size() * static_cast<std::size_t>(size));
    set_shifts(elimination_.point_sums(x));
    normal_.pool().parallel_for(static_cast<int>(graph.chunks.size()), [&](int chunk) {
      const Chunk& c = graph.chunks[chunk];
      double* sum = chunk_sums_.data() + size * chunk;
      std::fill_n(sum, size, 0.0);
      normal_.kernels().schur_product(normal_.jacobian(),
                                      c.begin,
                                      c.end,
                                      graph.point.data(),
                                      shifts_.data(),
                                      elimination_.expanded(c.camera),
                                      sum);
    });
    normal_.fold_chunks(chunk_sums_.data(), size, out.data());
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
  AlignedVector<double> chunk_sums_;  // per chunk: a camera block
};

}  // namespace

std::unique_ptr<SchurOperator> make_implicit_schur(const NormalEquations& normal,
                                                   PointElimination& elimination) {
  return std::make_unique<ImplicitSchur>(normal, elimination);
}

}  // namespace sfmcpp::linear

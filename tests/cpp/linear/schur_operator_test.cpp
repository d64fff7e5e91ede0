// The Schur complement in blocks against the one that is never formed.
#include "../../../cpp/src/linear/schur_operator.hpp"

#include <gtest/gtest.h>

#include "../../../cpp/src/linear/schur_preconditioner.hpp"
#include "support/random_system.hpp"

namespace sfmcpp::linear::block_sparse_schur_test {
namespace {

using support::RandomSystem;
using support::SystemOptions;
using Vector = std::vector<double>;

// Both ways to multiply, for one system and damping.
class TwoOperators {
 public:
  explicit TwoOperators(const SystemOptions& options)
      : system(options),
        elimination_(system.normal()),
        diagonal_(system.normal()),
        implicit_(make_implicit_schur(system.normal(), elimination_)),
        shares_(system.normal(),
                group_cameras(system.normal(), nullptr, PreconditionerKind::kAuto).clusters,
                std::vector<double>(system.graph.num_cameras, 1.0)),
        blocks_(system.normal(),
                elimination_,
                shares_,
                std::make_shared<ReducedStructure>(
                    ReducedStructure{.pattern = make_camera_pattern(
                                         system.graph, options.pairs, system.normal().pool())})) {
    elimination_.factor({1e-3, DampingMatrix::kDiagonal});
    blocks_.form(diagonal_);
    blocks_.gather(diagonal_, rhs);
  }

  Vector by_blocks(const Vector& x) { return product(blocks_, x); }
  Vector from_jacobian(const Vector& x) { return product(*implicit_, x); }
  Vector implicit_rhs() {
    Vector result;
    implicit_->form(diagonal_);
    implicit_->gather(diagonal_, result);
    return result;
  }

  RandomSystem system;
  Vector rhs;

 private:
  static Vector product(SchurOperator& schur, const Vector& x) {
    Vector out(x.size(), 0.0);
    schur.add_product(x, out);
    return out;
  }

  PointElimination elimination_;
  CameraBlockDiagonal diagonal_;
  std::unique_ptr<SchurOperator> implicit_;
  CameraPartition shares_;
  BlockSparseSchur blocks_;
};

Vector unit(int size, int k) {
  Vector x(static_cast<std::size_t>(size), 0.0);
  x[static_cast<std::size_t>(k)] = 1.0;
  return x;
}

class BlockSparse : public testing::TestWithParam<SystemOptions> {};

TEST_P(BlockSparse, MultipliesAsTheSchurComplementDoesButForRoundingToSinglePrecision) {
  TwoOperators schur(GetParam());
  for (unsigned seed : {1U, 2U, 3U}) {
    const Vector x = support::random_step(schur.system.map, seed).camera;
    const Vector blocks = schur.by_blocks(x), reference = schur.from_jacobian(x);
    double size = 0.0;
    for (double value : reference) size = std::max(size, std::abs(value));
    for (std::size_t k = 0; k < x.size(); ++k)
      EXPECT_NEAR(blocks[k], reference[k], 3e-6 * size) << "column " << k;
  }
}

TEST_P(BlockSparse, IsExactlySymmetric) {
  TwoOperators schur(GetParam());
  const int columns = std::min(schur.system.map.num_columns, 40);
  std::vector<Vector> rows;
  for (int k = 0; k < columns; ++k)
    rows.push_back(schur.by_blocks(unit(schur.system.map.num_columns, k)));
  for (int a = 0; a < columns; ++a) {
    // Entries of columns that cameras share are sums, whose order differs by side.
    for (int b = 0; b < a; ++b)
      EXPECT_NEAR(rows[a][b], rows[b][a], 1e-13 * (std::abs(rows[a][a]) + std::abs(rows[b][b])));
  }
}

// In double precision: the sums are compensated here, and not there.
TEST_P(BlockSparse, HasTheRightHandSideUnrounded) {
  TwoOperators schur(GetParam());
  const Vector reference = schur.implicit_rhs();
  double size = 0.0;
  for (double value : reference) size = std::max(size, std::abs(value));
  ASSERT_EQ(schur.rhs.size(), reference.size());
  for (std::size_t k = 0; k < reference.size(); ++k)
    EXPECT_NEAR(schur.rhs[k], reference[k], 1e-14 * size);
}

INSTANTIATE_TEST_SUITE_P(Systems,
                         BlockSparse,
                         testing::ValuesIn(support::random_systems()),
                         [](const auto& test) { return test.param.name; });

// More blocks than one task multiplies, in rows that reach over those of later tasks.
TEST(BlockSparseSchur, HasTheSameBitsForAnyNumberOfThreads) {
  SystemOptions options{.cameras = 150, .points = 60, .camera_size = 9, .dense = false};
  Vector first;
  for (int threads : {1, 2, 4}) {
    options.threads = threads;
    TwoOperators schur(options);
    const Vector product = schur.by_blocks(support::random_step(schur.system.map, 1).camera);
    if (first.empty()) first = product;
    EXPECT_EQ(product, first) << threads << " threads";
  }
}

}  // namespace
}  // namespace sfmcpp::linear::block_sparse_schur_test

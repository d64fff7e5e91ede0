// Rows of S whose pairs are listed in parts, against conjugate gradients, which form no pairs.
#include "sfmcpp/linear/schur_rows.hpp"

#include <cmath>

#include <gtest/gtest.h>

#include "support/random_system.hpp"

namespace sfmcpp::linear::schur_rows_test {
namespace {

using support::RandomSystem;

// A row of 43 cameras that see 420 points has 17,640 pairs, 21 for each observation.
support::SystemOptions long_tracks(int threads) {
  return {.cameras = 43, .points = 420, .camera_size = 9, .dense = false, .threads = threads};
}

Step step_of(const LinearSolverOptions& options, int threads = 1) {
  const RandomSystem system(long_tracks(threads));
  Step step;
  EXPECT_TRUE(system.solve(options, {1.0, DampingMatrix::kDiagonal}, step).success);
  return step;
}

TEST(SchurRows, PairsOfLongTracksAreNotKept) {
  const SchurKernels kernels = schur_kernels(9, Precision::kDouble);
  EXPECT_EQ(pair_list_bytes(kernels, 21.0 * 18060, 18060), 0.0);
  if (kernels.sum_pairs != nullptr) {
    EXPECT_EQ(pair_list_bytes(kernels, 50000, 18060), 50000 * sizeof(ObservationPair));
  }
}

TEST(SchurRows, LongTracksGiveTheStepOfConjugateGradients) {
  const Step direct = step_of({.kind = LinearSolverKind::kDense});
  const Step iterative = step_of(
      {.kind = LinearSolverKind::kIterative, .pcg_tolerance = 1e-14, .pcg_max_iterations = 2000});
  double error = 0.0, norm = 0.0;
  for (std::size_t k = 0; k < direct.camera.size(); ++k) {
    error = std::hypot(error, direct.camera[k] - iterative.camera[k]);
    norm = std::hypot(norm, direct.camera[k]);
  }
  EXPECT_LT(error, 1e-7 * norm);
}

TEST(SchurRows, LongTracksGiveTheSameBitsForEveryNumberOfThreads) {
  const Step one = step_of({.kind = LinearSolverKind::kSparse}, 1);
  const Step three = step_of({.kind = LinearSolverKind::kSparse}, 3);
  EXPECT_EQ(one.camera, three.camera);
  EXPECT_EQ(one.point, three.point);
}

}  // namespace
}  // namespace sfmcpp::linear::schur_rows_test

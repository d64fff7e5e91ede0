// Patches of smooth images, whose grey levels are known everywhere.
#include "sfmcpp/features/patches.hpp"

#include <cmath>
#include <limits>
#include <random>
#include <tuple>
#include <vector>

#include <gtest/gtest.h>

namespace sfmcpp::features::patches_test {
namespace {

constexpr int kRadius = 7;

// Waves of several directions, at (x, y) in pixels: (0.5, 0.5) is the centre of the first.
double waves(double x, double y) {
  return 120 + 30 * std::sin(0.31 * x + 0.1 * y) + 25 * std::sin(0.37 * y - 0.12 * x + 1) +
         15 * std::cos(0.2 * x + 0.23 * y);
}

// What is seen at a pixel (x, y) is at A (x, y) + b of the waves.
struct Warp {
  double a = 1, b = 0, c = 0, d = 1, x = 0, y = 0;
};

struct Image {
  int width = 120, height = 100;
  std::vector<float> pixels;

  explicit Image(const Warp& warp = {}, double gain = 1, double noise = 0, int seed = 1) {
    std::mt19937 random(seed);
    std::normal_distribution<double> normal;
    for (int row = 0; row < height; ++row) {
      for (int column = 0; column < width; ++column) {
        const double u = column + 0.5, v = row + 0.5;
        const double grey =
            waves(warp.a * u + warp.b * v + warp.x, warp.c * u + warp.d * v + warp.y);
        pixels.push_back(static_cast<float>(gain * grey + noise * normal(random)));
      }
    }
  }
  GreyLevel level() const { return {pixels.data(), width, height}; }
};

PatchPlace place(double x, double y, int level = 0) { return {{x, y}, {1, 0, 0, 1}, level}; }

std::vector<float> sampled(const Image& image, const PatchPlace& at, int radius = kRadius + 1) {
  std::vector<float> samples(static_cast<std::size_t>(patch_side(radius)) * patch_side(radius));
  const GreyLevel level = image.level();
  EXPECT_TRUE(sample_patch({&level, 1}, at, radius, samples.data()));
  return samples;
}

Alignment aligned(const Image& image, const std::vector<float>& templ, const PatchPlace& start) {
  const GreyLevel level = image.level();
  return PatchAligner(kRadius).align({&level, 1}, templ.data(), start);
}

TEST(Patches, SamplesLieWhereTheStepsPutThem) {
  const PatchPlace at{{50.2, 40.9}, {0.8, 0.3, -0.2, 1.1}, 0};
  const std::vector<float> samples = sampled(Image(), at, 2);
  for (int row = -2; row <= 2; ++row) {
    for (int column = -2; column <= 2; ++column) {
      const double x = 50.2 + 0.8 * column + 0.3 * row, y = 40.9 - 0.2 * column + 1.1 * row;
      EXPECT_NEAR(samples[(row + 2) * 5 + column + 2], waves(x, y), 1.5);
    }
  }
}

TEST(Patches, HalvedLevelsAreSampledAtTheSamePlaces) {
  Image full, half;
  half.width = 60, half.height = 50, half.pixels.clear();
  for (int row = 0; row < half.height; ++row) {
    for (int column = 0; column < half.width; ++column)
      half.pixels.push_back(static_cast<float>(waves(2 * column + 0.5, 2 * row + 0.5)));
  }
  const std::vector<GreyLevel> pyramid = {full.level(), half.level()};
  float one = 0, other = 0;
  ASSERT_TRUE(sample_patch(pyramid, {{50.5, 40.5}, {}, 0}, 0, &one));
  ASSERT_TRUE(sample_patch(pyramid, {{50.5, 40.5}, {}, 1}, 0, &other));
  EXPECT_FLOAT_EQ(one, other);
}

TEST(Patches, WhatIsNotAllWithinTheImageIsNotSampled) {
  const Image image;
  const GreyLevel level = image.level();
  std::vector<float> samples(patch_side(3) * patch_side(3));
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const auto& [x, y, inside] : {std::tuple{3.5, 3.5, true},
                                     {3.4, 50.0, false},
                                     {50.0, 3.4, false},
                                     {116.4, 96.4, true},
                                     {116.6, 50.0, false},
                                     {50.0, 96.6, false},
                                     {nan, 50.0, false},
                                     {1e300, 50.0, false}})
    EXPECT_EQ(sample_patch({&level, 1}, place(x, y), 3, samples.data()), inside) << x << " " << y;
}

TEST(Patches, AShiftIsFoundWhateverGainAndOffset) {
  const std::vector<float> templ = sampled(Image(), place(60, 50));
  // What is at (60, 50) is at (60 − 0.7, 50 + 0.4).
  const Alignment found = aligned(Image({.x = 0.7, .y = -0.4}, 0.6), templ, place(60, 50));
  EXPECT_GT(found.correlation, 0.999);
  EXPECT_NEAR(found.centre[0], 59.3, 0.01);
  EXPECT_NEAR(found.centre[1], 50.4, 0.01);
}

TEST(Patches, AShiftIsFoundInAnImageThatIsTurnedAndStretched) {
  const Warp warp{1.1, 0.3, -0.25, 0.9, -8, 9};
  const std::vector<float> templ = sampled(Image(), place(60, 50));
  // The place and the steps are the inverse of the warp.
  const double det = warp.a * warp.d - warp.b * warp.c, u = 60 - warp.x, v = 50 - warp.y;
  const double x = (warp.d * u - warp.b * v) / det, y = (-warp.c * u + warp.a * v) / det;
  PatchPlace start{{x + 0.5, y - 0.6}, {}, 0};
  start.step = {warp.d / det, -warp.b / det, -warp.c / det, warp.a / det};
  const Alignment found = aligned(Image(warp), templ, start);
  EXPECT_NEAR(found.centre[0], x, 0.02);
  EXPECT_NEAR(found.centre[1], y, 0.02);
}

TEST(Patches, CovariancesAreThoseOfTheErrorsThatNoiseMakes) {
  double uu = 0, vv = 0, expected_uu = 0, expected_vv = 0;
  constexpr int kTrials = 1000;
  std::mt19937 random(7);
  std::uniform_real_distribution<double> part(-0.5, 0.5);
  for (int trial = 0; trial < kTrials; ++trial) {
    const PatchPlace at = place(60 + part(random), 50 + part(random));
    const Alignment found = aligned(Image({}, 1, 6, trial), sampled(Image(), at), at);
    uu += std::pow(found.centre[0] - at.centre[0], 2) / kTrials;
    vv += std::pow(found.centre[1] - at.centre[1], 2) / kTrials;
    expected_uu += found.covariance[0] / kTrials;
    expected_vv += found.covariance[2] / kTrials;
  }
  EXPECT_NEAR(uu / expected_uu, 1, 0.3);
  EXPECT_NEAR(vv / expected_vv, 1, 0.3);
}

TEST(Patches, WhatHasNoTextureOrLooksDifferentIsNotAligned) {
  const std::vector<float> templ = sampled(Image(), place(60, 50));
  Image flat, edge;
  for (float& pixel : flat.pixels) pixel = 80;
  for (int k = 0; k < static_cast<int>(edge.pixels.size()); ++k)
    edge.pixels[k] = k % edge.width < 60 ? 20.0F : 200.0F;
  EXPECT_EQ(aligned(flat, templ, place(60, 50)).correlation, -1);
  EXPECT_EQ(aligned(Image(), sampled(flat, place(60, 50)), place(60, 50)).correlation, -1);
  EXPECT_EQ(aligned(edge, sampled(edge, place(60, 50)), place(60, 50)).correlation, -1)
      << "along an edge every place looks the same";
  EXPECT_LT(aligned(Image({.x = 30, .y = 22}), templ, place(60, 50)).correlation, 0.8);
  EXPECT_EQ(aligned(Image(), templ, place(8.2, 50)).correlation, -1) << "beyond the border";
}

}  // namespace
}  // namespace sfmcpp::features::patches_test

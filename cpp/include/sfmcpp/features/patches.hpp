// Square patches of images: sampled, and aligned to a template to a part of a pixel (S. Baker and
// I. Matthews, "Lucas-Kanade 20 years on: a unifying framework", IJCV 2004: inverse compositional,
// with gain and offset).
#pragma once

#include <array>
#include <span>
#include <vector>

namespace sfmcpp::features {

// Grey levels by rows. Pixel (i, j) of level l of a pyramid has its centre at (2ˡ i + ½, 2ˡ j + ½)
// in the pixels of level 0.
struct GreyLevel {
  const float* pixels;
  int width, height;
};

using Pyramid = std::span<const GreyLevel>;

// A patch in the pixels of level 0: its centre, and the derivative of the position with respect to
// the sample's column and row, by rows; and the level that is sampled.
struct PatchPlace {
  std::array<double, 2> centre;
  std::array<double, 4> step;
  int level;
};

inline constexpr int kMaxPatchRadius = 32;

inline constexpr int patch_side(int radius) { return 2 * radius + 1; }

// Bilinear samples, patch_side(radius)² of them by rows; false if the patch is not all within the
// image.
bool sample_patch(Pyramid pyramid, const PatchPlace& place, int radius, float* samples);

struct Alignment {
  std::array<double, 2> centre{};
  // Of the samples, weighted by the window; −1 where there is no alignment.
  double correlation = -1;
  // Σ_uu, Σ_uv, Σ_vv of the centre [px²], from what the samples do not have in common.
  std::array<double, 3> covariance{};
};

// Looks for the places where images look like templates. Templates are larger than what is compared
// by a sample on each side, of which gradients are made.
class PatchAligner {
 public:
  // Of what is compared.
  explicit PatchAligner(int radius);

  // `place` is where to start. Not for several threads at once.
  Alignment align(Pyramid pyramid, const float* templ, const PatchPlace& place);

 private:
  struct Pair {
    double x = 0, y = 0;
  };

  bool take_template(const float* templ);
  void take_gradients(const float* templ, double scale);
  bool take_information();
  // Whether the samples are not all equal; they are then of mean 0 and variance 1.
  bool normalise(std::vector<float>& samples, double* deviation) const;
  double correlation() const;
  // How far the patch is from the template [samples].
  Pair offset(double correlation) const;
  Alignment result(const PatchPlace& place, double correlation) const;

  int radius_;
  double effective_samples_;
  std::vector<float> window_, template_, patch_;
  std::vector<float> gradient_x_, gradient_y_;
  // Σ of products of gradients, weighted by the window, and its inverse.
  std::array<double, 3> information_{}, inverse_{};
};

}  // namespace sfmcpp::features

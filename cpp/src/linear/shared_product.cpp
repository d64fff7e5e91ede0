#include "shared_product.hpp"

namespace sfmcpp::linear {
namespace {

std::vector<char> own_cameras(const NormalEquations& normal, const CameraShares& shares) {
  std::vector<char> is_own(normal.graph().num_cameras);
  for (int i = 0; i < normal.graph().num_cameras; ++i) is_own[i] = shares.is_own(i);
  return is_own;
}

// With those that own ones are related to.
std::vector<char> touched_cameras(const NormalEquations& normal,
                                  const SchurOperator& schur,
                                  const std::vector<char>& is_own) {
  std::vector<char> touched = schur.touched_cameras();
  for (int i = 0; i < normal.graph().num_cameras; ++i) {
    if (!is_own[i]) continue;
    touched[i] = 1;
    normal.camera_terms().for_each_block(i, [&](int j, const double*) { touched[j] = 1; });
  }
  return touched;
}

}  // namespace

SharedProduct::SharedProduct(const NormalEquations& normal,
                             SchurOperator& schur,
                             const CameraShares& shares)
    : normal_(normal),
      schur_(schur),
      is_own_(own_cameras(normal, shares)),
      columns_(normal, shares, touched_cameras(normal, schur, is_own_)) {}

void SharedProduct::apply(const Vector& diagonal, const Vector& x, Vector& out) {
  const Vector& whole_x = columns_.spread(x);
  whole_.resize(whole_x.size());
  for (std::size_t k = 0; k < whole_.size(); ++k)
    whole_[k] = columns_.is_own(k) ? diagonal[k] * whole_x[k] : 0.0;
  schur_.add_product(whole_x, whole_);
  normal_.camera_terms().add_product(normal_.map(), is_own_, whole_x, whole_);
  columns_.collect(whole_, out);
}

}  // namespace sfmcpp::linear

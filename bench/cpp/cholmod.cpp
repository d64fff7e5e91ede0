#include "cholmod.hpp"

#include <new>

#include <cholmod.h>

namespace sfmcpp::bench {
namespace {

cholmod_sparse view_of(const SparseLower& matrix) {
  cholmod_sparse view{};
  view.nrow = view.ncol = matrix.column_begin.size() - 1;
  view.nzmax = matrix.row.size();
  // CHOLMOD reads these arrays only; its interface is not const.
  view.p = const_cast<std::int64_t*>(matrix.column_begin.data());
  view.i = const_cast<std::int64_t*>(matrix.row.data());
  view.x = const_cast<double*>(matrix.value.data());
  view.stype = -1;
  view.itype = CHOLMOD_LONG;
  view.xtype = CHOLMOD_REAL;
  view.dtype = CHOLMOD_DOUBLE;
  view.sorted = view.packed = 1;
  return view;
}

}  // namespace

struct Cholmod::State {
  cholmod_common common{};
  cholmod_factor* factor = nullptr;
};

Cholmod::Cholmod(const SparseLower& pattern) : state_(std::make_unique<State>()) {
  cholmod_common& common = state_->common;
  cholmod_l_start(&common);
  common.final_ll = 1;
  common.nmethods = 1;
  common.method[0].ordering = CHOLMOD_NATURAL;
  common.postorder = 1;
  cholmod_sparse view = view_of(pattern);
  state_->factor = cholmod_l_analyze(&view, &common);
  if (state_->factor == nullptr) throw std::bad_alloc();
}

Cholmod::~Cholmod() {
  cholmod_l_free_factor(&state_->factor, &state_->common);
  cholmod_l_finish(&state_->common);
}

bool Cholmod::factorize(const SparseLower& matrix) {
  cholmod_sparse view = view_of(matrix);
  cholmod_l_factorize(&view, state_->factor, &state_->common);
  return state_->common.status == CHOLMOD_OK && state_->factor->minor == state_->factor->n;
}

}  // namespace sfmcpp::bench

// SuiteSparse' sparse Cholesky, the rival of ours: linked by the benchmarks alone (its supernodal
// part is GPL).
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

namespace sfmcpp::bench {

// Lower triangle, compressed by columns, rows ascending, diagonal first.
struct SparseLower {
  std::vector<std::int64_t> column_begin{0};
  std::vector<std::int64_t> row;
  std::vector<double> value;
};

class Cholmod {
 public:
  // Analyses the pattern; the columns keep their order, up to subtrees that change places.
  explicit Cholmod(const SparseLower& pattern);
  ~Cholmod();
  Cholmod(const Cholmod&) = delete;
  Cholmod& operator=(const Cholmod&) = delete;

  bool factorize(const SparseLower& matrix);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace sfmcpp::bench

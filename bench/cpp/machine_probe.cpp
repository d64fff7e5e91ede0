// What this machine can do at most: multiply-adds a second in double and single precision, and
// bytes a second from memory, with one thread and with all. The roof of the picture in
// docs/benchmarks.md.
#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdio>
#include <thread>
#include <vector>

namespace {

// As wide as the registers for which the file is compiled.
#if defined(__AVX512F__)
constexpr std::size_t kBytes = 64;
#elif defined(__AVX__)
constexpr std::size_t kBytes = 32;
#else
constexpr std::size_t kBytes = 16;
#endif

// Enough chains to hide the latency of a multiply-add, few enough to stay in registers.
constexpr int kChains = 10;
constexpr long kRounds = 20'000'000;
constexpr std::size_t kDoubles = 16U << 20U;  // 128 MiB an array: far more than any cache

double seconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

template <class Scalar>
double multiply_add(double* sink) {
  typedef Scalar Vector __attribute__((vector_size(kBytes)));
  Vector x[kChains];
  for (int k = 0; k < kChains; ++k) x[k] = Vector{} + static_cast<Scalar>(1 + k);
  const Vector a = Vector{} + static_cast<Scalar>(0.999999),
               b = Vector{} + static_cast<Scalar>(1e-6);
  for (long round = 0; round < kRounds; ++round)
    for (int k = 0; k < kChains; ++k) x[k] = x[k] * a + b;
  Vector sum{};
  for (int k = 0; k < kChains; ++k) sum += x[k];
  *sink += static_cast<double>(sum[0]);
  return 2.0 * kRounds * kChains * static_cast<double>(kBytes / sizeof(Scalar));
}

double read_and_add(const std::vector<double>& values,
                    std::size_t begin,
                    std::size_t end,
                    double* sink) {
  double sum[8] = {};
  for (std::size_t k = begin; k + 8 <= end; k += 8)
    for (std::size_t lane = 0; lane < 8; ++lane) sum[lane] += values[k + lane];
  for (const double part : sum) *sink += part;
  return 8.0 * static_cast<double>(end - begin);
}

// Best of five of work(thread, sink) on so many threads, in units of work a second.
template <class Work>
double best_rate(int threads, const Work& work) {
  double best = 0.0;
  for (int repeat = 0; repeat < 5; ++repeat) {
    std::vector<double> done(static_cast<std::size_t>(threads)), sinks(done.size());
    const auto start = std::chrono::steady_clock::now();
    std::vector<std::thread> others;
    for (int t = 1; t < threads; ++t)
      others.emplace_back([&, t] {
        const auto k = static_cast<std::size_t>(t);
        done[k] = work(t, &sinks[k]);
      });
    done[0] = work(0, sinks.data());
    for (auto& other : others) other.join();
    const double seconds = seconds_since(start);
    double total = 0.0, unused = 0.0;
    for (const double part : done) total += part;
    for (const double part : sinks) unused += part;
    if (unused == 0.123456789) std::printf(" ");  // so that no work is left out
    best = std::max(best, total / seconds);
  }
  return best;
}

}  // namespace

int main() {
  const int all = std::max(1U, std::thread::hardware_concurrency());
  const std::vector<double> values(kDoubles, 1.0);
  std::printf("{\"vector_bytes\": %zu, \"by_threads\": {", kBytes);
  for (int threads = 1; threads <= all; threads += std::max(1, all - 1)) {
    const double in_double =
        best_rate(threads, [](int, double* sink) { return multiply_add<double>(sink); });
    const double in_single =
        best_rate(threads, [](int, double* sink) { return multiply_add<float>(sink); });
    const double read = best_rate(threads, [&](int t, double* sink) {
      const auto share = kDoubles / static_cast<std::size_t>(threads);
      const auto begin = share * static_cast<std::size_t>(t);
      return read_and_add(values, begin, begin + share, sink);
    });
    std::printf("%s\"%d\": {\"flops_double\": %.4g, \"flops_single\": %.4g, \"bytes_read\": %.4g}",
                threads == 1 ? "" : ", ",
                threads,
                in_double,
                in_single,
                read);
  }
  std::printf("}}\n");
  return 0;
}

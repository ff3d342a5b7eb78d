#include "experiments/reproducibility/machine_peaks.h"

#include <algorithm>
#include <barrier>
#include <chrono>
#include <cstdint>
#include <functional>
#include <thread>
#include <vector>

#if defined(__x86_64__)
#include <immintrin.h>
#endif

#include "core/check.h"

namespace segsim::experiments::reproducibility {
namespace {

using Clock = std::chrono::steady_clock;

constexpr int kRounds = 6;
constexpr int kChains =
    12;  // Independent sums: 2 ports x 4 ... 5 cycles of latency, and some.
constexpr int kBlock = 20000;  // Steps between two looks at the clock.
constexpr std::size_t kReadBytes = std::size_t{256} << 20U;

/// One block of multiply-adds. @return  Flops done; `sink` keeps the result alive.
using FlopBlock = double (*)(float& sink);
/// Combines all words. @return  Something that depends on each.
using ReadBlock = std::uint64_t (*)(const std::uint64_t* words, std::size_t count);

double flops_baseline(float& sink) {
  constexpr int kLanes = 4;
  float sums[kChains * kLanes];
  std::fill(std::begin(sums), std::end(sums), sink);
  for (int step = 0; step < kBlock; ++step) {
    for (float& sum : sums) sum = sum * 0.999F + 0.001F;
  }
  for (const float sum : sums) sink += sum * 1e-9F;
  return 2.0 * kBlock * kChains * kLanes;
}

std::uint64_t read_baseline(const std::uint64_t* words, std::size_t count) {
  std::uint64_t a = 0, b = 0, c = 0, d = 0;
  for (std::size_t i = 0; i + 4 <= count; i += 4) {
    a ^= words[i];
    b ^= words[i + 1];
    c ^= words[i + 2];
    d ^= words[i + 3];
  }
  return a ^ b ^ c ^ d;
}

#if defined(__x86_64__)
__attribute__((target("avx2,fma"))) double flops_avx2(float& sink) {
  __m256 sums[kChains];
  for (__m256& sum : sums) sum = _mm256_set1_ps(sink);
  const __m256 factor = _mm256_set1_ps(0.999F), term = _mm256_set1_ps(0.001F);
  for (int step = 0; step < kBlock; ++step) {
#pragma GCC unroll 12
    for (__m256& sum : sums) sum = _mm256_fmadd_ps(sum, factor, term);
  }
  __m256 total = sums[0];
  for (int k = 1; k < kChains; ++k) total = _mm256_add_ps(total, sums[k]);
  sink += _mm256_cvtss_f32(total) * 1e-9F;
  return 2.0 * kBlock * kChains * 8;
}

__attribute__((target("avx512f"))) double flops_avx512(float& sink) {
  __m512 sums[kChains];
  for (__m512& sum : sums) sum = _mm512_set1_ps(sink);
  const __m512 factor = _mm512_set1_ps(0.999F), term = _mm512_set1_ps(0.001F);
  for (int step = 0; step < kBlock; ++step) {
#pragma GCC unroll 12
    for (__m512& sum : sums) sum = _mm512_fmadd_ps(sum, factor, term);
  }
  __m512 total = sums[0];
  for (int k = 1; k < kChains; ++k) total = _mm512_add_ps(total, sums[k]);
  sink += _mm512_cvtss_f32(total) * 1e-9F;
  return 2.0 * kBlock * kChains * 16;
}

__attribute__((target("avx2"))) std::uint64_t read_avx2(const std::uint64_t* words,
                                                        std::size_t count) {
  __m256i sums[4];
  for (__m256i& sum : sums) sum = _mm256_setzero_si256();
  for (std::size_t i = 0; i + 16 <= count; i += 16) {
    for (int k = 0; k < 4; ++k) {
      const auto* at = reinterpret_cast<const __m256i*>(words + i + 4 * k);
      sums[k] = _mm256_xor_si256(sums[k], _mm256_loadu_si256(at));
    }
  }
  const __m256i total =
      _mm256_xor_si256(_mm256_xor_si256(sums[0], sums[1]), _mm256_xor_si256(sums[2], sums[3]));
  return static_cast<std::uint64_t>(_mm256_extract_epi64(total, 0));
}
#endif

struct Loops {
  FlopBlock flops = flops_baseline;
  ReadBlock read = read_baseline;
  const char* name = "baseline";
};

Loops best_loops() {
#if defined(__x86_64__)
  if (__builtin_cpu_supports("avx512f") != 0) return {flops_avx512, read_avx2, "AVX-512"};
  if (__builtin_cpu_supports("avx2") != 0 && __builtin_cpu_supports("fma") != 0) {
    return {flops_avx2, read_avx2, "AVX2"};
  }
#endif
  return {};
}

double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

/// Best sum over threads of units per second. @param block  block(thread) does some units.
double best_rate(int threads, double round_s, const std::function<double(int)>& block) {
  std::vector<std::vector<double>> rates(static_cast<std::size_t>(threads));
  std::barrier start_line(threads);
  const auto work = [&](int thread) {
    for (int round = 0; round < kRounds; ++round) {
      start_line.arrive_and_wait();
      const Clock::time_point start = Clock::now();
      double done = 0.0;
      do done += block(thread);
      while (seconds_since(start) < round_s);
      rates[static_cast<std::size_t>(thread)].push_back(done / seconds_since(start));
    }
  };
  std::vector<std::jthread> others;
  for (int t = 1; t < threads; ++t) others.emplace_back(work, t);
  work(0);
  others.clear();  // Joins.
  double best = 0.0;
  for (std::size_t round = 0; round < kRounds; ++round) {
    double sum = 0.0;
    for (const auto& of_thread : rates) sum += of_thread[round];
    best = std::max(best, sum);
  }
  return best;
}

}  // namespace

MachinePeaks measure_machine_peaks(int threads, double round_s) {
  SEGSIM_CHECK(threads > 0, "threads = " + std::to_string(threads));
  SEGSIM_CHECK(round_s > 0.0, "round_s = " + std::to_string(round_s));
  const Loops loops = best_loops();
  MachinePeaks peaks;
  peaks.threads = threads;
  peaks.vector_isa = loops.name;
  std::vector<float> sinks(static_cast<std::size_t>(threads) * 16, 0.5F);
  peaks.gflops = 1e-9 * best_rate(threads, round_s, [&](int thread) {
                   return loops.flops(sinks[static_cast<std::size_t>(thread) * 16]);
                 });

  const std::size_t share =
      kReadBytes / sizeof(std::uint64_t) / static_cast<std::size_t>(threads);
  const std::vector<std::uint64_t> memory(share * static_cast<std::size_t>(threads), 1);
  // Each thread walks through its share in pieces of at most 4 MiB, so that a round can end.
  const std::size_t piece = std::min(share, (std::size_t{4} << 20U) / sizeof(std::uint64_t));
  std::vector<std::size_t> places(static_cast<std::size_t>(threads) * 16, 0);
  std::vector<std::uint64_t> results(static_cast<std::size_t>(threads) * 16, 0);
  peaks.read_gbps = 1e-9 * best_rate(threads, round_s, [&](int thread) {
                      const auto t = static_cast<std::size_t>(thread);
                      std::size_t& place = places[t * 16];
                      if (place + piece > share) place = 0;
                      results[t * 16] ^= loops.read(memory.data() + t * share + place, piece);
                      place += piece;
                      return static_cast<double>(piece * sizeof(std::uint64_t));
                    });
  return peaks;
}

}  // namespace segsim::experiments::reproducibility

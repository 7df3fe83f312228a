#include "rsfm/mapping/sift_distances.h"

#include <algorithm>
#include <cstring>

#include "rsfm/base/vector_clones.h"

#if defined(__x86_64__)
#include <immintrin.h>
#endif

namespace rsfm {
namespace {

constexpr int kBytes = SiftBlock::kBytes, kRows = SiftBlock::kRows, kQueries = SiftBlock::kQueries;
constexpr int kCentre = 128;  // what makes bytes signed

std::int32_t SquaredNorm(const std::uint8_t* row) {
  std::int32_t sum = 0;
  for (int k = 0; k < kBytes; ++k) sum += static_cast<std::int32_t>(row[k]) * row[k];
  return sum;
}

std::int32_t Sum(const std::uint8_t* row) {
  std::int32_t sum = 0;
  for (int k = 0; k < kBytes; ++k) sum += row[k];
  return sum;
}

// From dot products to distances, in place.
RSFM_VECTOR_CLONES
void Finish(std::int32_t constant, const std::int32_t* squared_norms, std::int32_t* distances) {
  for (int j = 0; j < kRows; ++j) distances[j] = constant + squared_norms[j] - 2 * distances[j];
}

// dots[q][j] of 16-bit rows that lie one after the other.
RSFM_VECTOR_CLONES
void PortableDots(const std::int16_t* queries, const std::int16_t* rows, int count,
                  SiftBlock::Distances& dots) {
  for (int j = 0; j < count; ++j) {
    const std::int16_t* b = rows + j * kBytes;
    std::int32_t dot0 = 0, dot1 = 0, dot2 = 0, dot3 = 0;
    for (int k = 0; k < kBytes; ++k) {
      const std::int32_t value = b[k];
      dot0 += queries[k] * value;
      dot1 += queries[k + kBytes] * value;
      dot2 += queries[k + 2 * kBytes] * value;
      dot3 += queries[k + 3 * kBytes] * value;
    }
    dots[0][j] = dot0;
    dots[1][j] = dot1;
    dots[2][j] = dot2;
    dots[3][j] = dot3;
  }
}

#if defined(__x86_64__)

// `pairs`: for each two columns the pairs of all rows. Two queries and 32 rows at a time, so that
// the sums stay in registers.
__attribute__((target("avx2"))) void Avx2Dots(const std::int16_t* queries,
                                              const std::int16_t* pairs,
                                              SiftBlock::Distances& dots) {
  for (int q = 0; q < kQueries; q += 2) {
    for (int half = 0; half < 2; ++half) {
      __m256i sum[2][4];
      for (auto& of_query : sum)
        for (__m256i& s : of_query) s = _mm256_setzero_si256();
      for (int k = 0; k < kBytes / 2; ++k) {
        const std::int16_t* column = pairs + 2 * kRows * k + kRows * half;
        std::int32_t two[2];
        std::memcpy(&two[0], queries + q * kBytes + 2 * k, sizeof two[0]);
        std::memcpy(&two[1], queries + (q + 1) * kBytes + 2 * k, sizeof two[1]);
        const __m256i a0 = _mm256_set1_epi32(two[0]), a1 = _mm256_set1_epi32(two[1]);
        for (int i = 0; i < 4; ++i) {
          const __m256i b = _mm256_load_si256(reinterpret_cast<const __m256i*>(column + 16 * i));
          sum[0][i] = _mm256_add_epi32(sum[0][i], _mm256_madd_epi16(a0, b));
          sum[1][i] = _mm256_add_epi32(sum[1][i], _mm256_madd_epi16(a1, b));
        }
      }
      for (int r = 0; r < 2; ++r)
        for (int i = 0; i < 4; ++i)
          _mm256_storeu_si256(reinterpret_cast<__m256i*>(&dots[q + r][kRows / 2 * half + 8 * i]),
                              sum[r][i]);
    }
  }
}

// `quads`: for each four columns the quadruples of all rows, less 128, as the unit multiplies
// unsigned by signed bytes.
__attribute__((target("avx512f,avx512vnni"))) void VnniDots(const std::uint8_t* queries,
                                                            const std::int8_t* quads,
                                                            SiftBlock::Distances& dots) {
  __m512i sum[kQueries][4];
  for (auto& of_query : sum)
    for (__m512i& s : of_query) s = _mm512_setzero_si512();
  for (int k = 0; k < kBytes / 4; ++k) {
    const std::int8_t* column = quads + 4 * kRows * k;
    __m512i b[4];
    for (int i = 0; i < 4; ++i) b[i] = _mm512_load_si512(column + 64 * i);
    for (int q = 0; q < kQueries; ++q) {
      std::int32_t four;
      std::memcpy(&four, queries + q * kBytes + 4 * k, sizeof four);
      const __m512i a = _mm512_set1_epi32(four);
      for (int i = 0; i < 4; ++i) sum[q][i] = _mm512_dpbusd_epi32(sum[q][i], a, b[i]);
    }
  }
  for (int q = 0; q < kQueries; ++q)
    for (int i = 0; i < 4; ++i) _mm512_storeu_si512(&dots[q][16 * i], sum[q][i]);
}

#endif

}  // namespace

bool IsSupported(SiftKernel kernel) noexcept {
  if (kernel == SiftKernel::kPortable) return true;
#if defined(__x86_64__)
  __builtin_cpu_init();
  return kernel == SiftKernel::kAvx2
             ? __builtin_cpu_supports("avx2")
             : __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vnni");
#else
  return false;
#endif
}

SiftKernel BestSiftKernel() noexcept {
  for (const SiftKernel kernel : {SiftKernel::kAvx512Vnni, SiftKernel::kAvx2})
    if (IsSupported(kernel)) return kernel;
  return SiftKernel::kPortable;
}

void SiftBlock::Load(const std::uint8_t* rows, int count) noexcept {
  count_ = count;
  for (int j = 0; j < count; ++j) {
    const std::uint8_t* row = rows + j * kBytes;
    squared_norms_[j] = SquaredNorm(row);
    switch (kernel_) {
      case SiftKernel::kPortable:
        std::copy_n(row, kBytes, wide_ + j * kBytes);
        break;
      case SiftKernel::kAvx2:
        for (int k = 0; k < kBytes / 2; ++k)
          std::copy_n(row + 2 * k, 2, wide_ + 2 * (kRows * k + j));
        break;
      case SiftKernel::kAvx512Vnni:
        for (int k = 0; k < kBytes; ++k)
          quads_[4 * (kRows * (k / 4) + j) + k % 4] = static_cast<std::int8_t>(row[k] - kCentre);
        break;
    }
  }
}

std::int32_t SiftBlock::Constant(const std::uint8_t* query) const noexcept {
  const std::int32_t norm = SquaredNorm(query);
  return kernel_ == SiftKernel::kAvx512Vnni ? norm - 2 * kCentre * Sum(query) : norm;
}

void SiftBlock::Measure(const std::uint8_t* queries, const std::int32_t* constants, int num_queries,
                        Distances& distances) const noexcept {
  std::uint8_t padded[kQueries * kBytes];
  if (num_queries < kQueries) {
    std::memset(padded, 0, sizeof padded);
    std::memcpy(padded, queries, static_cast<std::size_t>(num_queries) * kBytes);
    queries = padded;
  }
#if defined(__x86_64__)
  if (kernel_ == SiftKernel::kAvx512Vnni) {
    VnniDots(queries, quads_, distances);
  } else
#endif
  {
    std::int16_t wide[kQueries * kBytes];
    std::copy_n(queries, kQueries * kBytes, wide);
#if defined(__x86_64__)
    if (kernel_ == SiftKernel::kAvx2) {
      Avx2Dots(wide, wide_, distances);
    } else
#endif
    {
      PortableDots(wide, wide_, count_, distances);
    }
  }
  for (int q = 0; q < num_queries; ++q) Finish(constants[q], squared_norms_, distances[q]);
}

}  // namespace rsfm

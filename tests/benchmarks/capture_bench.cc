// Conversions to grey, 1280 x 960, each with its ratio to the loop one writes first: pixel by pixel
// through a function of the format, as a bench tool has it.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <chrono>
#include <limits>
#include <vector>

#include "rsfm/base/rng.h"
#include "rsfm_drivers/v4l2/grey.h"

namespace rsfm {
namespace {

constexpr int kWidth = 1280, kHeight = 960;

int At(const std::uint8_t* raw, int stride, int x, int y) {
  x = x < 0 ? 1 : x >= kWidth ? kWidth - 2 : x;
  y = y < 0 ? 1 : y >= kHeight ? kHeight - 2 : y;
  return raw[y * stride + x];
}

std::uint8_t PlainPixel(PixelFormat format, const std::uint8_t* raw, int stride, int x, int y) {
  const std::uint8_t* row = raw + y * stride;
  switch (format) {
    case PixelFormat::kYuyv:
      return row[2 * x];
    case PixelFormat::kY16:
      return row[2 * x + 1];
    case PixelFormat::kY10:
      return static_cast<std::uint8_t>(std::min((row[2 * x] + 256 * row[2 * x + 1]) / 4, 255));
    case PixelFormat::kBayer8: {
      int sum = 8;
      for (int dy = -1; dy <= 1; ++dy) {
        for (int dx = -1; dx <= 1; ++dx)
          sum += (2 - std::abs(dx)) * (2 - std::abs(dy)) * At(raw, stride, x + dx, y + dy);
      }
      return static_cast<std::uint8_t>(sum / 16);
    }
    default:
      return row[x];
  }
}

void PlainConvert(PixelFormat format, const std::uint8_t* raw, int stride, std::uint8_t* grey) {
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) grey[y * kWidth + x] = PlainPixel(format, raw, stride, x, y);
  }
}

template <class F>
double BestSeconds(int repetitions, F&& f) {
  double best = std::numeric_limits<double>::infinity();
  for (int i = 0; i < repetitions; ++i) {
    const auto start = std::chrono::steady_clock::now();
    f();
    best = std::min(
        best, std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
  }
  return best;
}

void Convert(benchmark::State& state) {
  const auto format = static_cast<PixelFormat>(state.range(0));
  const bool is_wide =
      format == PixelFormat::kYuyv || format == PixelFormat::kY16 || format == PixelFormat::kY10;
  const int stride = is_wide ? 2 * kWidth : kWidth;
  Rng rng(1);
  std::vector<std::uint8_t> raw(static_cast<std::size_t>(stride) * kHeight * 3 / 2);
  for (auto& byte : raw) byte = static_cast<std::uint8_t>(rng.Uniform(0.0, 255.99));
  std::vector<std::uint8_t> grey(kWidth * kHeight), plain(kWidth * kHeight);
  auto converter = GreyConverter::Create({format, kWidth, kHeight, stride});
  const double baseline =
      BestSeconds(20, [&] { PlainConvert(format, raw.data(), stride, plain.data()); });
  double best = std::numeric_limits<double>::infinity();
  bool is_good = converter.has_value();
  for (auto _ : state)
    best =
        std::min(best, BestSeconds(1, [&] { is_good &= !!converter->Convert(raw, grey.data()); }));
  if (!is_good || grey != plain) state.SkipWithError("results differ");
  state.counters["ms"] = 1e3 * best;
  state.counters["ms_baseline"] = 1e3 * baseline;
  state.counters["ratio"] = baseline / best;
  state.counters["percent_of_core_at_30Hz"] = 100.0 * 30.0 * best;
}

BENCHMARK(Convert)
    ->Name("Grey/format")
    ->Arg(static_cast<int>(PixelFormat::kGrey))
    ->Arg(static_cast<int>(PixelFormat::kY16))
    ->Arg(static_cast<int>(PixelFormat::kY10))
    ->Arg(static_cast<int>(PixelFormat::kNv12))
    ->Arg(static_cast<int>(PixelFormat::kYuyv))
    ->Arg(static_cast<int>(PixelFormat::kBayer8))
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace rsfm

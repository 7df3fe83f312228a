#include "tools/offline/chance.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>

namespace rsfm {
namespace {

// std::lgamma writes a variable of the whole process: not for threads.
double LogFactorial(int n) {
  int sign = 0;
  return ::lgamma_r(n + 1.0, &sign);
}

double LogChoose(int n, int k) {
  return (LogFactorial(n) - LogFactorial(k) - LogFactorial(n - k)) / std::log(10.0);
}

}  // namespace

double LogFalseAlarms(std::span<const MatchedPixels> matches, std::span<const char> inlier,
                      double max_error_px, int width, int height) {
  constexpr double kCells = 8.0;
  constexpr int kMinimal = 5, kSolutions = 10;
  const auto cell = [width](const Vec2& pixel) {
    const Vec2 scaled = kCells / width * pixel;
    return static_cast<std::int64_t>(std::floor(scaled.y())) * 1024 +
           static_cast<std::int64_t>(std::floor(scaled.x()));
  };
  std::map<std::int64_t, int> groups;  // inliers less others
  for (std::size_t i = 0; i < matches.size(); ++i)
    groups[cell(matches[i].a) * 1'000'000 + cell(matches[i].b)] += inlier[i] != 0 ? 1 : -1;
  const int n = static_cast<int>(groups.size());
  const int k = static_cast<int>(std::count_if(groups.begin(), groups.end(),
                                               [](const auto& group) { return group.second > 0; }));
  if (k <= kMinimal) return std::log10(static_cast<double>(kSolutions));
  // A match at random lies in the band about a line, which is no longer than the diagonal.
  const double band = std::min(
      1.0, 2.0 * max_error_px * std::hypot(width, height) / (static_cast<double>(width) * height));
  return std::log10(static_cast<double>(kSolutions) * (n - kMinimal)) + LogChoose(n, k) +
         LogChoose(k, kMinimal) + (k - kMinimal) * std::log10(band);
}

}  // namespace rsfm

#include "rsfm/mapping/patch_describer.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numbers>

#include "rsfm/mapping/float8.h"

namespace rsfm {
namespace {

constexpr float kSigma = 1.94f;  // on top of the half pixel that every image has
constexpr int kTaps = 15;        // of the smoothing
constexpr float kCellPx = 6.0f;
constexpr int kRadius = 21;  // of what falls into a cell, whatever the direction
constexpr int kSide = 2 * kRadius + 1;
constexpr int kSmoothSide = kSide + 2;  // one pixel around, for the gradients
constexpr int kStride = 48;             // whole vectors
constexpr int kSourceSide = kSmoothSide + kTaps - 1;
constexpr int kSourceStride = 64;
constexpr int kCells = 4, kDirections = 8;
constexpr int kCentroidRadius = 15;
static_assert(PatchDescriber::kBorderPx >= kSourceSide / 2 + 8 + 1);

// Weights of a Gaussian about a point that lies `fraction` after the middle tap.
void Gaussian(float fraction, float (&taps)[kTaps]) {
  float sum = 0.0f;
  for (int k = 0; k < kTaps; ++k) {
    const float x = static_cast<float>(k - kTaps / 2) - fraction;
    sum += taps[k] = std::exp(-0.5f * x * x / (kSigma * kSigma));
  }
  for (float& tap : taps) tap /= sum;
}

RSFM_VECTOR_CLONES
void Widen(const std::uint8_t* from, int stride_bytes, float* to) {
  for (int y = 0; y < kSourceSide; ++y) {
    for (int x = 0; x < kSourceStride; ++x) to[x] = from[x];
    from += stride_bytes;
    to += kSourceStride;
  }
}

RSFM_VECTOR_CLONES
void SmoothAcross(const float* from, const float (&taps)[kTaps], float* to) {
  for (int y = 0; y < kSourceSide; ++y) {
    for (int x = 0; x < kStride; x += kLanes) {
      Float8 sum{};
      for (int k = 0; k < kTaps; ++k) sum += taps[k] * RSFM_LOAD8(from + x + k);
      RSFM_STORE8(sum, to + x);
    }
    from += kSourceStride;
    to += kStride;
  }
}

RSFM_VECTOR_CLONES
void SmoothDown(const float* from, const float (&taps)[kTaps], float* to) {
  for (int y = 0; y < kSmoothSide; ++y) {
    for (int x = 0; x < kStride; x += kLanes) {
      Float8 sum{};
      for (int k = 0; k < kTaps; ++k) sum += taps[k] * RSFM_LOAD8(from + k * kStride + x);
      RSFM_STORE8(sum, to + x);
    }
    from += kStride;
    to += kStride;
  }
}

// Length of the gradient, weighted, and its direction in turns of the circle's eighths, 0 to 8,
// from `turn` on. The arcus tangens is good to 1e-4 rad [Abramowitz & Stegun 1964, 4.4.49].
RSFM_VECTOR_CLONES
void Gradients(const float* smooth, const float* weights, float turn, float* __restrict size,
               float* __restrict direction) {
  constexpr float kToEighths = static_cast<float>(kDirections / (2.0 * std::numbers::pi));
  for (int i = 0; i < kSide * kStride; ++i) {
    const float dx = smooth[i + kStride + 2] - smooth[i + kStride];
    const float dy = smooth[i + 2 * kStride + 1] - smooth[i + 1];
    const float ax = std::abs(dx), ay = std::abs(dy);
    const float ratio = std::min(ax, ay) / (std::max(ax, ay) + 1e-9f);
    const float s = ratio * ratio;
    float angle =
        ratio *
        (0.9998660f + s * (-0.3302995f + s * (0.1801410f + s * (-0.0851330f + s * 0.0208351f))));
    angle = ay > ax ? 1.57079633f - angle : angle;
    angle = dx < 0.0f ? 3.14159265f - angle : angle;
    angle = dy < 0.0f ? -angle : angle;
    float eighths = angle * kToEighths - turn;
    eighths = eighths < 0.0f ? eighths + kDirections : eighths;
    eighths = eighths < 0.0f ? eighths + kDirections : eighths;
    direction[i] = eighths >= kDirections ? eighths - kDirections : eighths;
    size[i] = weights[i] * std::sqrt(dx * dx + dy * dy);
  }
}

// Direction of the intensity centroid about the pixel nearest to the place.
double CentroidDirection(const PyramidLevel& image, PatchPlace at) {
  const auto cx = static_cast<int>(std::lround(at.x)), cy = static_cast<int>(std::lround(at.y));
  std::int64_t mx = 0, my = 0;
  for (int dy = -kCentroidRadius; dy <= kCentroidRadius; ++dy) {
    const std::uint8_t* row =
        image.origin + static_cast<std::ptrdiff_t>(cy + dy) * image.stride_bytes + cx;
    const auto half = static_cast<int>(std::sqrt(kCentroidRadius * kCentroidRadius - dy * dy));
    int sum = 0, moment = 0;
    for (int dx = -half; dx <= half; ++dx) {
      sum += row[dx];
      moment += dx * row[dx];
    }
    mx += moment;
    my += static_cast<std::int64_t>(dy) * sum;
  }
  return std::atan2(static_cast<double>(my), static_cast<double>(mx));
}

// Every gradient into the two nearest cells along each axis and the two nearest directions.
void Gather(const float* size, const float* direction, double angle, float* values) {
  float bins[kCells + 2][kCells + 2][kDirections + 2] = {};
  const auto c = static_cast<float>(std::cos(angle) / kCellPx);
  const auto s = static_cast<float>(std::sin(angle) / kCellPx);
  for (int y = -kRadius; y <= kRadius; ++y) {
    for (int x = -kRadius; x <= kRadius; ++x) {
      const auto fx = static_cast<float>(x), fy = static_cast<float>(y);
      const float column = c * fx + s * fy + 0.5f * kCells + 0.5f;  // 1 is the first cell's centre
      const float row = -s * fx + c * fy + 0.5f * kCells + 0.5f;
      if (!(column > 0.0f && row > 0.0f && column < kCells + 1 && row < kCells + 1)) continue;
      const int i = (y + kRadius) * kStride + x + kRadius;
      const auto c0 = static_cast<int>(column), r0 = static_cast<int>(row);
      const auto d0 = static_cast<int>(direction[i]);
      const float fc = column - static_cast<float>(c0), fr = row - static_cast<float>(r0);
      const float fd = direction[i] - static_cast<float>(d0);
      const float lower = size[i] * fr, upper = size[i] - lower;
      const float parts[2][2] = {{upper - upper * fc, upper * fc},
                                 {lower - lower * fc, lower * fc}};
      for (int dr = 0; dr < 2; ++dr) {
        for (int dc = 0; dc < 2; ++dc) {
          float* bin = bins[r0 + dr][c0 + dc] + d0;
          bin[1] += parts[dr][dc] * fd;
          bin[0] += parts[dr][dc] - parts[dr][dc] * fd;
        }
      }
    }
  }
  for (int row = 0; row < kCells; ++row) {
    for (int column = 0; column < kCells; ++column) {
      float* bin = bins[row + 1][column + 1];
      bin[0] += bin[kDirections];
      bin[1] += bin[kDirections + 1];
      std::copy(bin, bin + kDirections, values);
      values += kDirections;
    }
  }
}

// No gradient may outweigh the others [Lowe 2004, sec. 6.1].
void Limit(float* values) {
  float squares = 0.0f;
  for (int i = 0; i < 128; ++i) squares += values[i] * values[i];
  const float most = 0.2f * std::sqrt(squares);
  for (int i = 0; i < 128; ++i) values[i] = std::min(values[i], most);
}

}  // namespace

void PackRootSift(const float* values, std::uint8_t* packed) noexcept {
  std::memset(packed, 0, 128);
  float sum = 0.0f;
  for (int k = 0; k < 128; ++k) sum += values[k];
  if (!(sum > 0.0f)) return;
  for (int k = 0; k < 128; ++k) {
    const float root = 512.0f * std::sqrt(values[k] / sum);
    packed[k] = static_cast<std::uint8_t>(std::min(255.0f, root + 0.5f));
  }
}

PatchDescriber::PatchDescriber()
    : pixels_(kSourceSide * kSourceStride + kSourceSide * kStride + (kSmoothSide + 1) * kStride +
              3 * kSide * kStride) {
  pixels_.TryResize(pixels_.capacity());
  source_ = pixels_.data();
  across_ = source_ + kSourceSide * kSourceStride;
  smooth_ = across_ + kSourceSide * kStride;
  weights_ = smooth_ + (kSmoothSide + 1) * kStride;
  size_ = weights_ + kSide * kStride;
  direction_ = size_ + kSide * kStride;
  const float two_squares = 2.0f * (0.5f * kCells * kCellPx) * (0.5f * kCells * kCellPx);
  for (int y = -kRadius; y <= kRadius; ++y) {
    for (int x = -kRadius; x <= kRadius; ++x)
      weights_[(y + kRadius) * kStride + x + kRadius] =
          std::exp(-static_cast<float>(x * x + y * y) / two_squares);
  }
}

void PatchDescriber::Describe(const PyramidLevel& image, PatchPlace at,
                              std::uint8_t* packed) noexcept {
  const float floor_x = std::floor(at.x), floor_y = std::floor(at.y);
  const int left = static_cast<int>(floor_x) - kSourceSide / 2;
  const int top = static_cast<int>(floor_y) - kSourceSide / 2;
  float taps_x[kTaps], taps_y[kTaps];
  Gaussian(at.x - floor_x, taps_x);
  Gaussian(at.y - floor_y, taps_y);
  Widen(image.origin + static_cast<std::ptrdiff_t>(top) * image.stride_bytes + left,
        image.stride_bytes, source_);
  SmoothAcross(source_, taps_x, across_);
  SmoothDown(across_, taps_y, smooth_);
  const double angle = CentroidDirection(image, at);
  Gradients(smooth_, weights_, static_cast<float>(angle * kDirections / (2.0 * std::numbers::pi)),
            size_, direction_);
  float values[128];
  Gather(size_, direction_, angle, values);
  Limit(values);
  PackRootSift(values, packed);
}

}  // namespace rsfm

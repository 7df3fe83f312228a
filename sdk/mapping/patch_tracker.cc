#include "rsfm/mapping/patch_tracker.h"

#include <algorithm>
#include <cmath>

#include "rsfm/mapping/float8.h"

namespace rsfm {
namespace {

std::size_t Count(int value) { return static_cast<std::size_t>(value); }

bool IsInside(const PyramidLevel& level, PatchPlace at) {
  return at.x >= -0.5f && at.y >= -0.5f && at.x <= static_cast<float>(level.width) - 0.5f &&
         at.y <= static_cast<float>(level.height) - 0.5f;  // never with NaN
}

RSFM_VECTOR_CLONES
void Widen(const std::uint8_t* from, int stride_bytes, int rows, int columns, float* to) {
  for (int y = 0; y < rows; ++y) {
    for (int x = 0; x < columns; ++x) to[x] = from[x];
    from += stride_bytes;
    to += columns;
  }
}

// Between the pixels of a tile; `columns` is whole vectors.
RSFM_VECTOR_CLONES
void Interpolate(const float* pixel, int tile_stride, float fx, float fy, int rows, int columns,
                 float* out) {
  for (int c = 0; c < columns; c += kLanes) {
    const float* p = pixel + c;
    Float8 above = RSFM_LOAD8(p) + fx * (RSFM_LOAD8(p + 1) - RSFM_LOAD8(p));
    for (int r = 0; r < rows; ++r) {
      p += tile_stride;
      const Float8 below = RSFM_LOAD8(p) + fx * (RSFM_LOAD8(p + 1) - RSFM_LOAD8(p));
      RSFM_STORE8(above + fy * (below - above), out + r * columns + c);
      above = below;
    }
  }
}

// Sums over a template: gx, gy, t; then gx^2, gx gy, gy^2, gx t, gy t, t^2.
struct TemplateSums {
  float x, y, t, xx, xy, yy, xt, yt, tt;
};

// Gradients by central differences; columns beyond the window are zero.
RSFM_VECTOR_CLONES
void Differentiate(const float* wide, int wide_stride, int rows, int stride, const float* mask,
                   float* t, float* gx, float* gy, TemplateSums* sums) {
  Float8 x{}, y{}, s{}, xx{}, xy{}, yy{}, xt{}, yt{}, tt{};
  for (int c = 0; c < stride; c += kLanes) {
    const Float8 m = RSFM_LOAD8(mask + c);
    const float* here = wide + wide_stride + c + 1;
    for (int r = 0; r < rows; ++r) {
      const Float8 value = RSFM_LOAD8(here) * m;
      const Float8 dx = (RSFM_LOAD8(here + 1) - RSFM_LOAD8(here - 1)) * 0.5f * m;
      const Float8 dy =
          (RSFM_LOAD8(here + wide_stride) - RSFM_LOAD8(here - wide_stride)) * 0.5f * m;
      RSFM_STORE8(value, t);
      RSFM_STORE8(dx, gx);
      RSFM_STORE8(dy, gy);
      x += dx;
      y += dy;
      s += value;
      xx += dx * dx;
      xy += dx * dy;
      yy += dy * dy;
      xt += dx * value;
      yt += dy * value;
      tt += value * value;
      here += wide_stride;
      t += kLanes;
      gx += kLanes;
      gy += kLanes;
    }
  }
  *sums = {RSFM_SUM8(x),  RSFM_SUM8(y),  RSFM_SUM8(s),  RSFM_SUM8(xx), RSFM_SUM8(xy),
           RSFM_SUM8(yy), RSFM_SUM8(xt), RSFM_SUM8(yt), RSFM_SUM8(tt)};
}

// What light may do to the patch.
struct Light {
  float mean_t, mean_x, mean_y, slope_x, slope_y;
};

// Takes the mean from the patch, mean and multiples of the patch from its gradients.
RSFM_VECTOR_CLONES
void ProjectOut(const Light& light, int rows, int stride, const float* mask, float* t, float* gx,
                float* gy) {
  for (int c = 0; c < stride; c += kLanes) {
    const Float8 m = RSFM_LOAD8(mask + c);
    for (int r = 0; r < rows; ++r) {
      const Float8 value = (RSFM_LOAD8(t) - light.mean_t) * m;
      RSFM_STORE8(value, t);
      RSFM_STORE8(RSFM_LOAD8(gx) - light.mean_x * m - light.slope_x * value, gx);
      RSFM_STORE8(RSFM_LOAD8(gy) - light.mean_y * m - light.slope_y * value, gy);
      t += kLanes;
      gx += kLanes;
      gy += kLanes;
    }
  }
}

// Sums over the patch of gradient times difference. The template itself drops out: the gradients
// are at right angles to it.
RSFM_VECTOR_CLONES
void Compare(const float* pixel, int tile_stride, float fx, float fy, int rows, int stride,
             const float* gx, const float* gy, float* sum_x, float* sum_y) {
  Float8 bx{}, by{};
  for (int c = 0; c < stride; c += kLanes) {
    const float* p = pixel + c;
    Float8 above = RSFM_LOAD8(p) + fx * (RSFM_LOAD8(p + 1) - RSFM_LOAD8(p));
    for (int r = 0; r < rows; ++r) {
      p += tile_stride;
      const Float8 below = RSFM_LOAD8(p) + fx * (RSFM_LOAD8(p + 1) - RSFM_LOAD8(p));
      const Float8 value = above + fy * (below - above);
      bx += value * RSFM_LOAD8(gx);
      by += value * RSFM_LOAD8(gy);
      gx += kLanes;
      gy += kLanes;
      above = below;
    }
  }
  *sum_x = RSFM_SUM8(bx);
  *sum_y = RSFM_SUM8(by);
}

struct CorrelationSums {
  float i, ii, it;
};

RSFM_VECTOR_CLONES
void Correlate(const float* pixel, int tile_stride, float fx, float fy, int rows, int stride,
               const float* mask, const float* t, CorrelationSums* sums) {
  Float8 i{}, ii{}, it{};
  for (int c = 0; c < stride; c += kLanes) {
    const Float8 m = RSFM_LOAD8(mask + c);
    const float* p = pixel + c;
    Float8 above = RSFM_LOAD8(p) + fx * (RSFM_LOAD8(p + 1) - RSFM_LOAD8(p));
    for (int r = 0; r < rows; ++r) {
      p += tile_stride;
      const Float8 below = RSFM_LOAD8(p) + fx * (RSFM_LOAD8(p + 1) - RSFM_LOAD8(p));
      const Float8 value = (above + fy * (below - above)) * m;
      i += value;
      ii += value * value;
      it += value * RSFM_LOAD8(t);
      t += kLanes;
      above = below;
    }
  }
  *sums = {RSFM_SUM8(i), RSFM_SUM8(ii), RSFM_SUM8(it)};
}

}  // namespace

PatchTracker::PatchTracker(const PatchTrackerOptions& options)
    : options_(options),
      stride_((options.window_px + kLanes - 1) / kLanes * kLanes),
      tile_stride_(stride_ + 2 * kLanes) {
  const std::size_t area = Count(options.window_px) * Count(stride_);
  wide_ = FixedVector<float>(Count(options.window_px + 2) * Count(stride_ + kLanes));
  patch_ = FixedVector<float>(3 * area + Count(stride_));
  tile_ = FixedVector<float>(Count(tile_stride_) * Count(options.window_px + 3 + 2 * kMargin));
  wide_.TryResize(wide_.capacity());
  patch_.TryResize(patch_.capacity());
  tile_.TryResize(tile_.capacity());
  for (int x = 0; x < options.window_px; ++x) patch_[3 * area + Count(x)] = 1.0f;
}

void PatchTracker::TakeTile(const PyramidLevel& level, int left, int top) noexcept {
  tile_left_ = left;
  tile_top_ = top;
  has_tile_ = true;
  Widen(level.origin + static_cast<std::ptrdiff_t>(top) * level.stride_bytes + left,
        level.stride_bytes, options_.window_px + 3 + 2 * kMargin, tile_stride_, tile_.data());
}

PatchTracker::InTile PatchTracker::Locate(const PyramidLevel& level, PatchPlace at) noexcept {
  const float floor_x = std::floor(at.x), floor_y = std::floor(at.y);
  const int left = static_cast<int>(floor_x) - options_.window_px / 2;
  const int top = static_cast<int>(floor_y) - options_.window_px / 2;
  const bool is_within = has_tile_ && left >= tile_left_ && left <= tile_left_ + 2 * kMargin - 1 &&
                         top >= tile_top_ && top <= tile_top_ + 2 * kMargin;
  if (!is_within) TakeTile(level, left - kMargin, top - kMargin);
  return {tile_.data() + (top - tile_top_) * tile_stride_ + (left - tile_left_), at.x - floor_x,
          at.y - floor_y};
}

bool PatchTracker::TakeTemplate(const PyramidLevel& level, PatchPlace at) noexcept {
  const int window = options_.window_px, wide_stride = stride_ + kLanes;
  const std::size_t area = Count(window) * Count(stride_);
  float *t = patch_.data(), *gx = t + area, *gy = gx + area;
  const float* mask = gy + area;
  // Columns of the wide patch beyond the window's need only be numbers.
  has_tile_ = false;
  const InTile in = Locate(level, at);
  Interpolate(in.pixel - tile_stride_ - 1, tile_stride_, in.fx, in.fy, window + 2, wide_stride,
              wide_.data());
  TemplateSums s;
  Differentiate(wide_.data(), wide_stride, window, stride_, mask, t, gx, gy, &s);

  const auto n = static_cast<float>(window * window);
  const Light mean{s.t / n, s.x / n, s.y / n, 0.0f, 0.0f};
  const float tt = s.tt - n * mean.mean_t * mean.mean_t;
  if (!(tt > n * options_.min_texture)) return false;
  const float xt = s.xt - n * mean.mean_x * mean.mean_t, yt = s.yt - n * mean.mean_y * mean.mean_t;
  const float xx = s.xx - n * mean.mean_x * mean.mean_x - xt * xt / tt;
  const float xy = s.xy - n * mean.mean_x * mean.mean_y - xt * yt / tt;
  const float yy = s.yy - n * mean.mean_y * mean.mean_y - yt * yt / tt;
  const float smaller = 0.5f * (xx + yy - std::hypot(xx - yy, 2.0f * xy));
  const float determinant = xx * yy - xy * xy;
  if (!(smaller > n * options_.min_texture) || !(determinant > 0.0f)) return false;
  normal_ = {yy / determinant, -xy / determinant, xx / determinant, tt};
  ProjectOut({mean.mean_t, mean.mean_x, mean.mean_y, xt / tt, yt / tt}, window, stride_, mask, t,
             gx, gy);
  return true;
}

// Gauss-Newton on one level, from *at; false, and *at as it was, if it leads away or nowhere.
bool PatchTracker::Descend(const PyramidLevel& level, float epsilon_px, PatchPlace* at) noexcept {
  const int window = options_.window_px;
  const std::size_t area = Count(window) * Count(stride_);
  const float *gx = patch_.data() + area, *gy = gx + area;
  const auto reach = static_cast<float>(window);
  PatchPlace place = *at;
  float last_x = 0.0f, last_y = 0.0f, length = 0.0f;
  has_tile_ = false;
  for (int step = 0; step < options_.max_iterations; ++step) {
    if (!IsInside(level, place)) return false;
    const InTile in = Locate(level, place);
    float bx, by;
    Compare(in.pixel, tile_stride_, in.fx, in.fy, window, stride_, gx, gy, &bx, &by);
    float dx = -(normal_.inverse_xx * bx + normal_.inverse_xy * by);
    float dy = -(normal_.inverse_xy * bx + normal_.inverse_yy * by);
    // To and fro: half-way is where it meets.
    if (step > 0 && std::abs(dx + last_x) < 0.1f * std::abs(dx) + epsilon_px &&
        std::abs(dy + last_y) < 0.1f * std::abs(dy) + epsilon_px) {
      dx *= 0.5f;
      dy *= 0.5f;
    }
    place.x += dx;
    place.y += dy;
    last_x = dx;
    last_y = dy;
    length = std::hypot(dx, dy);
    if (!(std::hypot(place.x - at->x, place.y - at->y) <= reach)) return false;
    if (length < epsilon_px) break;
  }
  if (!(length < std::max(10.0f * epsilon_px, 0.1f)) || !IsInside(level, place)) return false;
  *at = place;
  return true;
}

float PatchTracker::Correlation(const PyramidLevel& level, PatchPlace at) noexcept {
  const int window = options_.window_px;
  const float* mask = patch_.data() + 3 * Count(window) * Count(stride_);
  const InTile in = Locate(level, at);
  CorrelationSums s;
  Correlate(in.pixel, tile_stride_, in.fx, in.fy, window, stride_, mask, patch_.data(), &s);
  const auto n = static_cast<float>(window * window);
  const float squares = s.ii - s.i * s.i / n;
  return squares > 0.0f ? s.it / std::sqrt(squares * normal_.patch_squares) : 0.0f;
}

bool PatchTracker::Track(const ImagePyramid& from, const ImagePyramid& to, PatchPlace start,
                         int top_level, PatchPlace* found) noexcept {
  const int top = std::min({top_level, from.num_levels() - 1, to.num_levels() - 1});
  if (top < 0 || !IsInside(from.level(0), start) || !IsInside(to.level(0), *found)) return false;
  PatchPlace place = *found;
  for (int i = top; i >= 0; --i) {
    const float scale = 1.0f / static_cast<float>(1 << i);
    const bool has_texture = TakeTemplate(from.level(i), {start.x * scale, start.y * scale});
    PatchPlace at{place.x * scale, place.y * scale};
    const float epsilon_px = i > 0 ? 4.0f * options_.epsilon_px : options_.epsilon_px;
    const bool is_found = has_texture && Descend(to.level(i), epsilon_px, &at);
    if (is_found) place = {at.x / scale, at.y / scale};
    if (i == 0 && !is_found) return false;  // a coarse level may fail: the next begins as it did
  }
  if (!(Correlation(to.level(0), place) >= options_.min_correlation)) return false;
  *found = place;
  return true;
}

}  // namespace rsfm

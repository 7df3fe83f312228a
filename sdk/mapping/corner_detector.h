// Corners [Shi & Tomasi 1994, CVPR] of one part of an image: where the smaller eigenvalue of the
// gradients' second moments over 5 x 5 px is largest. Fixed memory: a few rows.
#pragma once

#include <span>

#include "rsfm/base/fixed_vector.h"
#include "rsfm/mapping/image_pyramid.h"

namespace rsfm {

struct Corner {
  float x = 0.0f, y = 0.0f;  // the centre of the top-left pixel is (0, 0)
  float score = 0.0f;        // the eigenvalue's mean, (grey / px)^2
};

// Half-open, pixels, within the image.
struct ImagePart {
  int left = 0, top = 0, right = 0, bottom = 0;
};

class CornerDetector {
 public:
  static constexpr int kBorderPx = 16;  // what the image must have around it

  // The only place that allocates: for parts of at most this width.
  explicit CornerDetector(int max_width_px);

  // The strongest corners of the part, at least min_score, strongest first (ties: in reading
  // order), each the maximum of its 3 x 3 pixels and interpolated between them. Returns how many
  // were written, at most corners.size(). Precondition: the part is no wider than max_width_px.
  int Detect(const PyramidLevel& image, const ImagePart& part, float min_score,
             std::span<Corner> corners) noexcept;

  std::size_t bytes() const { return products_.bytes() + scores_.bytes(); }

 private:
  void AddRow(const PyramidLevel& image, int left, int columns, int y) noexcept;
  const float* ScoreRow(int columns, int y) noexcept;

  int stride_ = 0;
  FixedVector<std::int32_t> products_;  // of the last five rows, summed along the row
  FixedVector<float> scores_;           // of the last three
};

}  // namespace rsfm

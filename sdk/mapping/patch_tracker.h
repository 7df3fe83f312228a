// Where a patch of one image lies in another: pyramidal Lucas-Kanade in fixed memory.
//
// Translation alone, from coarse to fine [Bouguet 2001, Intel, "Pyramidal implementation of the
// affine Lucas Kanade feature tracker"], in the inverse compositional form: gradients and normal
// matrix are the template's and are computed once a level [Baker & Matthews 2004, IJCV, sec. 3.2].
// A change of light within the patch, I' = (1 + a) I + b, is projected out of the gradients
// [Hager & Belhumeur 1998, PAMI, sec. 3.1], so that it costs nothing per iteration.
//
// Pixels here have the centre of the top-left pixel at (0, 0).
#pragma once

#include <cstddef>

#include "rsfm/base/fixed_vector.h"
#include "rsfm/mapping/image_pyramid.h"

namespace rsfm {

struct PatchPlace {
  float x = 0.0f, y = 0.0f;
};

struct PatchTrackerOptions {
  int window_px = 21;            // side of the patch, odd
  int max_iterations = 20;       // per level
  float epsilon_px = 0.01f;      // a step shorter than this ends a level; four times that above 0
  float min_texture = 0.1f;      // smaller eigenvalue of the mean squared gradient, (grey / px)^2
  float min_correlation = 0.7f;  // of the patches, light projected out, at the end
};

class PatchTracker {
 public:
  // The only place that allocates.
  explicit PatchTracker(const PatchTrackerOptions& options);

  // What the pyramids must have as border_px.
  int border_px() const { return options_.window_px / 2 + kReach; }

  // Looks in `to` for the patch about `start` in `from`, from level `top_level` down, beginning at
  // *found. At most top_level + 1 times max_iterations steps. False, and *found as it was, where
  // there is no texture, the patch leaves the image, the steps do not converge, or what is found
  // does not look like the patch.
  bool Track(const ImagePyramid& from, const ImagePyramid& to, PatchPlace start, int top_level,
             PatchPlace* found) noexcept;

  std::size_t bytes() const { return wide_.bytes() + patch_.bytes() + tile_.bytes(); }

 private:
  static constexpr int kMargin = 4;  // steps of so many pixels stay within the tile
  static constexpr int kReach = 20;  // pixels read beyond a patch: margin and whole vectors

  struct Normal {
    float inverse_xx = 0.0f, inverse_xy = 0.0f, inverse_yy = 0.0f;
    float patch_squares = 0.0f;  // of the patch less its mean
  };

  // The patch's top left pixel within the tile, and what is left over.
  struct InTile {
    const float* pixel;
    float fx, fy;
  };
  void TakeTile(const PyramidLevel& level, int left, int top) noexcept;
  InTile Locate(const PyramidLevel& level, PatchPlace at) noexcept;
  bool TakeTemplate(const PyramidLevel& level, PatchPlace at) noexcept;
  bool Descend(const PyramidLevel& level, float epsilon_px, PatchPlace* at) noexcept;
  float Correlation(const PyramidLevel& level, PatchPlace at) noexcept;

  PatchTrackerOptions options_;
  int stride_ = 0;       // columns of a patch, in whole vectors
  int tile_stride_ = 0;  // of the tile, and floats in its row
  int tile_left_ = 0, tile_top_ = 0;
  bool has_tile_ = false;  // of the level under work
  Normal normal_;
  FixedVector<float> wide_;  // the patch and one pixel around it
  // Columns of eight, one below the other: the patch less its mean, its gradients along x and y;
  // then the mask of one row.
  FixedVector<float> patch_;
  FixedVector<float> tile_;  // a part of an image as floats
};

}  // namespace rsfm

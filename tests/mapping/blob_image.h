// An image of Gaussian blobs at known places: what a detector should find is known to a fraction of
// a pixel.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "rsfm/base/rng.h"
#include "rsfm/mapping/feature.h"

namespace rsfm {

struct Blob {
  Vec2 pixel;  // the centre of the top-left pixel is (0.5, 0.5)
  double sigma_px;
  double height;
};

class BlobImage {
 public:
  static constexpr int kWidth = 480, kHeight = 320;

  // Blobs in the cells of a grid, so that they stay apart; `shift` moves all of them.
  explicit BlobImage(const Vec2& shift = Vec2::Zero(), double min_sigma_px = 2.0,
                     double max_sigma_px = 4.0) {
    Rng rng(5);
    std::vector<double> light(kWidth * kHeight, 110.0);
    for (int row = 0; row < 7; ++row) {
      for (int column = 0; column < 11; ++column) {
        const Vec2 pixel(42.0 * column + rng.Uniform(24.0, 34.0),
                         42.0 * row + rng.Uniform(24.0, 34.0));
        const double height = (rng.Uniform() < 0.5 ? -1.0 : 1.0) * rng.Uniform(50.0, 90.0);
        blobs_.push_back({pixel + shift, rng.Uniform(min_sigma_px, max_sigma_px), height});
      }
    }
    for (const Blob& blob : blobs_) Draw(blob, &light);
    SetBytes(light);
  }

  // Blobs of all sizes over each other: a texture in which no place looks like another.
  static BlobImage Texture(const Vec2& shift) {
    BlobImage image;
    image.blobs_.clear();
    Rng rng(6);
    std::vector<double> light(kWidth * kHeight, 110.0);
    for (int i = 0; i < 1500; ++i) {
      const Vec2 pixel(rng.Uniform(-20.0, kWidth + 20.0), rng.Uniform(-20.0, kHeight + 20.0));
      image.blobs_.push_back({pixel + shift, rng.Uniform(1.5, 7.0), rng.Uniform(-45.0, 45.0)});
      Draw(image.blobs_.back(), &light);
    }
    image.SetBytes(light);
    return image;
  }

  const std::vector<Blob>& blobs() const { return blobs_; }
  ImageView View() const { return {bytes_.data(), kWidth, kHeight, kWidth, 1}; }
  std::vector<std::uint8_t>& bytes() { return bytes_; }

 private:
  void SetBytes(const std::vector<double>& light) {
    bytes_.clear();
    for (const double value : light)
      bytes_.push_back(static_cast<std::uint8_t>(std::clamp(value + 0.5, 0.0, 255.0)));
  }
  static void Draw(const Blob& blob, std::vector<double>* light) {
    const int reach = static_cast<int>(5.0 * blob.sigma_px) + 1;
    const int cx = static_cast<int>(blob.pixel.x()), cy = static_cast<int>(blob.pixel.y());
    for (int y = std::max(0, cy - reach); y < std::min(kHeight, cy + reach); ++y) {
      for (int x = std::max(0, cx - reach); x < std::min(kWidth, cx + reach); ++x) {
        const double squared = (Vec2(x + 0.5, y + 0.5) - blob.pixel).squaredNorm();
        (*light)[static_cast<std::size_t>(y * kWidth + x)] +=
            blob.height * std::exp(-0.5 * squared / (blob.sigma_px * blob.sigma_px));
      }
    }
  }

  std::vector<Blob> blobs_;
  std::vector<std::uint8_t> bytes_;
};

}  // namespace rsfm

// What the front end hands to the mapper: features of one image, and where asked for, their
// descriptors.
#pragma once

#include <cstdint>
#include <span>

#include "rsfm/base/linear.h"
#include "rsfm/base/time.h"
#include "rsfm/mapping/mapper_options.h"

namespace rsfm {

// An 8-bit image in somebody else's memory.
struct ImageView {
  const std::uint8_t* data = nullptr;
  int width = 0;
  int height = 0;
  int stride_bytes = 0;
  int channels = 1;  // 1 grey, 3 blue-green-red
};

inline constexpr std::uint32_t kNoTrack = 0xFFFFFFFFu;

struct Feature {
  float x_px = 0.0f;  // the centre of the top-left pixel is (0.5, 0.5)
  float y_px = 0.0f;
  float size_px = 0.0f;  // diameter of the region
  std::uint32_t track =
      kNoTrack;  // same number, same scene point, in images that follow each other
  std::uint8_t r = 0, g = 0, b = 0;

  Vec2 pixel() const { return {x_px, y_px}; }
};

// Descriptors as the matcher reads them: rows of DescriptorStride bytes, padded with zeros.
struct DescriptorView {
  const std::uint8_t* data = nullptr;
  int count = 0;
  DescriptorType type = DescriptorType::kNone;

  const std::uint8_t* Row(int i) const;
};

constexpr int DescriptorStride(DescriptorType type) {
  switch (type) {
    case DescriptorType::kOrb:
      return 32;
    case DescriptorType::kSift:
      return 128;
    case DescriptorType::kAkaze:
      return 64;
    case DescriptorType::kNone:
      break;
  }
  return 0;
}

inline const std::uint8_t* DescriptorView::Row(int i) const {
  return data + static_cast<std::ptrdiff_t>(i) * DescriptorStride(type);
}

struct FrameObservations {
  Utime utime = 0;
  std::span<const Feature> features;
  DescriptorView descriptors;  // as many as features, or none: a frame between keyframes
};

}  // namespace rsfm

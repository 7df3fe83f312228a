// An image's descriptors as the desk compares them.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "rsfm/mapping/feature.h"

namespace rsfm {

struct DescriptorRows {
  DescriptorType type = DescriptorType::kNone;
  std::vector<std::uint8_t> all;      // one row per feature
  std::vector<std::uint8_t> preview;  // those of the largest features, the largest first

  DescriptorView All() const { return View(all); }
  DescriptorView Preview() const { return View(preview); }

 private:
  DescriptorView View(const std::vector<std::uint8_t>& rows) const;
};

// `all` has a row for each of `sizes_px`, or there are no sizes and the first rows are the preview.
DescriptorRows PrepareDescriptors(DescriptorType type, std::vector<std::uint8_t> all,
                                  std::span<const float> sizes_px, int preview_features);

}  // namespace rsfm

// The features of one image, and the file that keeps them between runs.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "rsfm/io/diagnostic.h"
#include "rsfm/mapping/feature.h"

namespace rsfm {

struct ImageFeatures {
  std::vector<Vec2> pixels;
  std::vector<float> sizes_px;
  std::vector<std::array<std::uint8_t, 3>> colours;
  DescriptorType type = DescriptorType::kNone;
  std::vector<std::uint8_t> descriptors;  // rows of DescriptorStride bytes, as many as pixels

  int Size() const { return static_cast<int>(pixels.size()); }
  DescriptorView Descriptors() const { return {descriptors.data(), Size(), type}; }
};

// 64 bits that differ where any byte does, in practice.   [Fowler, Noll & Vo, FNV-1a, by words]
std::uint64_t Fingerprint(std::string_view bytes, std::uint64_t seed = 0);

// `key` names what the features were made from: the image's bytes and the options.
IoStatus WriteFeatures(const std::filesystem::path& path, std::uint64_t key,
                       const ImageFeatures& features);
// Nothing when the file is not there, damaged, or made from something else.
std::optional<ImageFeatures> ReadFeatures(const std::filesystem::path& path, std::uint64_t key);

}  // namespace rsfm

// Features of a folder of images: each image searched once, the result kept in the working folder.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "rsfm/mapping/mapper_options.h"
#include "tools/feed/image_list.h"
#include "tools/reconstruction/image_features.h"

namespace rsfm {

struct ExtractionOptions {
  DescriptorType type = DescriptorType::kSift;
  int max_features = 3000;
  double contrast_limit = 0.0;  // CLAHE's clip limit for murky water; 0 leaves the image as it is
  ImageMask mask;
  int num_threads = 2;
  // Images done, in all; false stops.
  std::function<bool(int, int)> progress;
};

// An image that was not used, and why.
struct LeftOutImage {
  std::string image;
  std::string reason;
};

struct ExtractedImage {
  std::string name;
  Utime utime = 0;
  std::uint64_t key = 0;       // of its features' file
  std::uint64_t contents = 0;  // fingerprint of the image file
  int num_features = 0;
};

struct Extraction {
  bool interrupted = false;
  std::vector<ExtractedImage> images;  // in the list's order, without those left out
  std::vector<LeftOutImage> left_out;  // unreadable, of another size, duplicates, featureless
  int num_cached = 0;                  // of the images, found in the working folder
  double seconds = 0.0;
};

// Where the features of an image lie in the working folder.
std::filesystem::path FeaturesPath(const std::filesystem::path& work, const std::string& image);

// Image files that are the same, byte for byte, count once. Errors: the working folder cannot be
// written; no image is left, with the first one's reason.
IoExpected<Extraction> ExtractFeatures(const ImageList& list, int width_px, int height_px,
                                       const std::filesystem::path& work,
                                       const ExtractionOptions& options);

}  // namespace rsfm

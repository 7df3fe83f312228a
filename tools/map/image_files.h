// Images from files: which there are, when they were taken, and reading them with suspicion.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <vector>

#include "rsfm/io/tables.h"
#include "rsfm/mapping/feature.h"

namespace rsfm {

struct ImageList {
  std::filesystem::path folder;              // where the images lie
  std::vector<ImageTime> images;             // in the order of time
  std::optional<std::filesystem::path> nav;  // nav.csv of a mission folder
};

// `images` is a folder of images, or a mission folder with images/ and, where they are not given,
// images.csv and nav.csv. Times come from `times`, else from images.csv, else from the order of the
// names (numbers in them by value) at `fps`, the first at 0. Errors: no such folder, no image in
// it, a listed image that is not there.
IoExpected<ImageList> ListImages(const std::filesystem::path& images,
                                 const std::optional<std::filesystem::path>& times, double fps);

// Orders "frame2" before "frame10".
bool NaturalLess(std::string_view a, std::string_view b);

// Reads one image after the other into its own memory.
class ImageReader {
 public:
  ImageReader(int width_px, int height_px);
  ~ImageReader();

  // The view lasts until the next call. Errors name the file: not readable, not an image, cut off
  // (JPEG without its end marker, PNG without its end chunk: decoders fill such up with grey), or
  // of another size than the camera's.
  IoExpected<ImageView> Read(const std::filesystem::path& path);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace rsfm

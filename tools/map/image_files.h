// Reading image files with suspicion.
#pragma once

#include <filesystem>
#include <memory>

#include "rsfm/mapping/feature.h"
#include "tools/feed/image_list.h"

namespace rsfm {

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

// Images from files: which there are, and when they were taken.
#pragma once

#include <filesystem>
#include <optional>
#include <string_view>
#include <vector>

#include "rsfm/io/tables.h"

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

}  // namespace rsfm

// COLMAP's images and points3D files as they are: elements refer to each other by id. For sdk/io's
// own readers and writers; model.h is what others use.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "rsfm/io/diagnostic.h"
#include "rsfm/io/model.h"

namespace rsfm {

inline constexpr std::uint64_t kNoColmapPoint = UINT64_MAX;  // -1 in text

struct ColmapImage {
  ModelImage image;  // camera and points are not set
  std::uint32_t camera_id = 0;
  std::vector<std::uint64_t> point_ids;  // per feature
};
struct ColmapPoint {
  ModelPoint point;                                            // track is not set
  std::vector<std::pair<std::uint32_t, std::uint32_t>> track;  // image id, feature
};

// kCorrupt or kInvalidArgument with the line; nothing that is not finite gets through.
IoExpected<std::vector<ColmapImage>> ParseColmapImagesText(const std::string& text,
                                                           const std::string& name);
IoExpected<std::vector<ColmapPoint>> ParseColmapPointsText(const std::string& text,
                                                           const std::string& name);
IoExpected<std::vector<ColmapImage>> ParseColmapImagesBinary(const std::string& bytes,
                                                             const std::string& name);
IoExpected<std::vector<ColmapPoint>> ParseColmapPointsBinary(const std::string& bytes,
                                                             const std::string& name);

std::string FormatColmapImagesText(const std::vector<ColmapImage>& images);
std::string FormatColmapPointsText(const std::vector<ColmapPoint>& points);
std::string FormatColmapImagesBinary(const std::vector<ColmapImage>& images);
std::string FormatColmapPointsBinary(const std::vector<ColmapPoint>& points);

// The unit quaternion (w x y z) and translation of a file; false when they are none.
bool SetPose(const double (&values)[7], Rigid3* camera_from_world);

}  // namespace rsfm

#include "rsfm/refraction/camera_config.h"

namespace rsfm {

std::string_view ToString(PortType type) noexcept {
  switch (type) {
    case PortType::kNone:
      return "none";
    case PortType::kFlat:
      return "flat";
    case PortType::kDome:
      return "dome";
  }
  return "unknown";
}

PortParams PortConfig::Params() const noexcept {
  const Vec3& vector = type == PortType::kDome ? center_m : normal;
  const double length = type == PortType::kDome ? radius_m : distance_m;
  return {vector.x(),  vector.y(), vector.z(),  length,
          thickness_m, index_air,  index_glass, index_water};
}

void PortConfig::SetParams(const PortParams& params) noexcept {
  const Vec3 vector(params[0], params[1], params[2]);
  if (type == PortType::kDome) {
    center_m = vector;
    radius_m = params[3];
  } else {
    normal = vector;
    distance_m = params[3];
  }
  thickness_m = params[4];
  index_air = params[5];
  index_glass = params[6];
  index_water = params[7];
}

}  // namespace rsfm

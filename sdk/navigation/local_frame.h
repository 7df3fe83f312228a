// Local north-east-down at a point on or near the ellipsoid, in place of latitude, longitude and
// height. GeographicLib does the geodesy.
#pragma once

#include "rsfm/base/error.h"
#include "rsfm/base/linear.h"

namespace rsfm {

// WGS84. Height above the ellipsoid.
struct Geodetic {
  double latitude_deg = 0.0;   // [-90, 90]
  double longitude_deg = 0.0;  // [-180, 180]
  double height_m = 0.0;
};

class LocalFrame {
 public:
  // kInvalidArgument for a latitude beyond the poles, a longitude beyond [-540, 540) or anything
  // not finite; `where` names the field.
  static Expected<LocalFrame> Create(const Geodetic& origin) noexcept;

  const Geodetic& origin() const { return origin_; }

  // Exact (through geocentric coordinates), at any distance; neither allocates.
  Vec3 NedFromGeodetic(const Geodetic& place) const noexcept;
  Geodetic GeodeticFromNed(const Vec3& position_ned_m) const noexcept;

 private:
  explicit LocalFrame(const Geodetic& origin) : origin_(origin) {}

  Geodetic origin_;
  Vec3 origin_ecef_m_ = Vec3::Zero();
  Mat3 ned_from_ecef_ = Mat3::Identity();
};

}  // namespace rsfm

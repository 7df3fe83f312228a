#include "rsfm/navigation/local_frame.h"

#include <GeographicLib/Geocentric.hpp>
#include <cmath>

namespace rsfm {
namespace {

const GeographicLib::Geocentric& Earth() { return GeographicLib::Geocentric::WGS84(); }

Vec3 EcefFromGeodetic(const Geodetic& place) {
  Vec3 ecef;
  Earth().Forward(place.latitude_deg, place.longitude_deg, place.height_m, ecef.x(), ecef.y(),
                  ecef.z());
  return ecef;
}

}  // namespace

Expected<LocalFrame> LocalFrame::Create(const Geodetic& origin) noexcept {
  if (!(std::abs(origin.latitude_deg) <= 90.0)) return Fail(Errc::kInvalidArgument, "latitude_deg");
  if (!(std::abs(origin.longitude_deg) <= 540.0))
    return Fail(Errc::kInvalidArgument, "longitude_deg");
  if (!std::isfinite(origin.height_m)) return Fail(Errc::kInvalidArgument, "height_m");

  LocalFrame frame(origin);
  frame.origin_ecef_m_ = EcefFromGeodetic(origin);
  constexpr double kRadPerDeg = 3.14159265358979323846 / 180.0;
  const double latitude = origin.latitude_deg * kRadPerDeg;
  const double longitude = origin.longitude_deg * kRadPerDeg;
  const double sin_lat = std::sin(latitude), cos_lat = std::cos(latitude);
  const double sin_lon = std::sin(longitude), cos_lon = std::cos(longitude);
  frame.ned_from_ecef_ << -sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat,  // north
      -sin_lon, cos_lon, 0.0,                                               // east
      -cos_lat * cos_lon, -cos_lat * sin_lon, -sin_lat;                     // down
  return frame;
}

Vec3 LocalFrame::NedFromGeodetic(const Geodetic& place) const noexcept {
  return ned_from_ecef_ * (EcefFromGeodetic(place) - origin_ecef_m_);
}

Geodetic LocalFrame::GeodeticFromNed(const Vec3& position_ned_m) const noexcept {
  const Vec3 ecef = ned_from_ecef_.transpose() * position_ned_m + origin_ecef_m_;
  Geodetic place;
  Earth().Reverse(ecef.x(), ecef.y(), ecef.z(), place.latitude_deg, place.longitude_deg,
                  place.height_m);
  return place;
}

}  // namespace rsfm

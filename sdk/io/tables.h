// The two CSV tables of the desk: image times and navigation.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "rsfm/base/time.h"
#include "rsfm/io/diagnostic.h"
#include "rsfm/navigation/local_frame.h"
#include "rsfm/navigation/nav_sample.h"

namespace rsfm {

struct ImageTime {
  std::string image;  // file name
  Utime utime = 0;    // mid-exposure
};

// `image,utime`. Times must increase strictly, names must differ.
IoExpected<std::vector<ImageTime>> ReadImageTimes(const std::filesystem::path& path);
IoStatus WriteImageTimes(const std::vector<ImageTime>& images, const std::filesystem::path& path);

struct NavTable {
  std::vector<NavSample> samples;  // never backwards in time
  // The origin of north, east, down where the table has latitudes: the argument, or else the
  // table's first position.
  std::optional<Geodetic> origin;
};

// A header names the columns present, any subset of: utime or image; north_m east_m down_m or
// latitude_deg longitude_deg height_m; depth_m; altitude_m; roll_rad pitch_rad heading_rad or qw qx
// qy qz (ned_from_body); vx_mps vy_mps vz_mps (body, FRD); temperature_c salinity_psu; each with an
// optional sigma_<column>. An empty field is "not measured"; a group counts only where all its
// fields are there. Unknown columns, times that run backwards, NaN and infinities are errors that
// name line and column. `images` gives the times where the table has `image` instead of utime.
// Beside latitudes sigma_north_m and sigma_east_m may stand for sigma_latitude_deg and
// sigma_longitude_deg.
// Also colmap_underwater's navigation: its names of the columns ("Latitude [deg]", "Yaw SD [rad]";
// "DateTime [...]", in UTC, for utime), and a folder with a file of one row for each image, named
// as that is. Its world begins at the first image's place; here that is at its depth.
IoExpected<NavTable> ReadNavTable(const std::filesystem::path& path,
                                  const std::vector<ImageTime>& images = {},
                                  const std::optional<Geodetic>& origin = std::nullopt);
// utime, north_m ..., quaternions; only the columns that some sample has.
IoStatus WriteNavTable(const std::vector<NavSample>& samples, const std::filesystem::path& path);

// Roll, pitch, heading [rad] to ned_from_body and back: yaw, then pitch, then roll (ZYX, FRD).
Quat QuatFromRollPitchHeading(double roll_rad, double pitch_rad, double heading_rad);
Vec3 RollPitchHeading(const Quat& ned_from_body);

}  // namespace rsfm

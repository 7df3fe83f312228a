#include "rsfm/io/tables.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>

#include "rsfm/base/plausible_time.h"
#include "rsfm/io/csv.h"
#include "rsfm/io/text.h"

namespace rsfm {
namespace {

// Column numbers, in the order of kColumns.
enum Column : std::size_t {
  kNorth,
  kEast,
  kDown,
  kLatitude,
  kLongitude,
  kHeight,
  kDepth,
  kAltitude,
  kRoll,
  kPitch,
  kHeading,
  kQw,
  kQx,
  kQy,
  kQz,
  kVx,
  kVy,
  kVz,
  kTemperature,
  kSalinity,
  kNumColumns,
};
struct ColumnInfo {
  std::string_view name;
  double low, high;
  const char* fix;
};
constexpr double kTwoPi = 2.0 * 3.14159265358979323846;
constexpr const char* kMetresFix = "give metres";
constexpr const char* kRadiansFix = "give radians from -2 pi to 2 pi";
constexpr const char* kUnitFix = "give a unit quaternion, ned from body";
constexpr const char* kSpeedFix =
    "give m/s along the body's axes, or leave the field empty where there is no measurement";
constexpr std::array<ColumnInfo, kNumColumns> kColumns = {{
    {"north_m", -1e8, 1e8, kMetresFix},
    {"east_m", -1e8, 1e8, kMetresFix},
    {"down_m", -2e4, 2e4, kMetresFix},
    {"latitude_deg", -90.0, 90.0, "give degrees from -90 to 90"},
    {"longitude_deg", -180.0, 360.0, "give degrees from -180 to 360"},
    {"height_m", -2e4, 2e4, "give metres above the ellipsoid"},
    {"depth_m", -100.0, 12000.0, "give metres below the surface, down positive"},
    {"altitude_m", 0.0, 12000.0,
     "give metres above the bottom, or leave the field empty where there is no measurement"},
    {"roll_rad", -kTwoPi, kTwoPi, kRadiansFix},
    {"pitch_rad", -kTwoPi, kTwoPi, kRadiansFix},
    {"heading_rad", -kTwoPi, kTwoPi, kRadiansFix},
    {"qw", -1.001, 1.001, kUnitFix},
    {"qx", -1.001, 1.001, kUnitFix},
    {"qy", -1.001, 1.001, kUnitFix},
    {"qz", -1.001, 1.001, kUnitFix},
    {"vx_mps", -30.0, 30.0, kSpeedFix},
    {"vy_mps", -30.0, 30.0, kSpeedFix},
    {"vz_mps", -30.0, 30.0, kSpeedFix},
    {"temperature_c", -5.0, 60.0, "give degrees Celsius"},
    {"salinity_psu", 0.0, 100.0, "give practical salinity units"},
}};

// colmap_underwater's names of the same columns. Its sigmas of a position are along north and east,
// in metres.
constexpr std::string_view kDateTime = "DateTime [%Y-%m-%d %H:%M:%S.%f]";
struct Alias {
  std::string_view theirs, ours;
};
constexpr std::array<Alias, 13> kAliases = {{
    {"Latitude [deg]", "latitude_deg"},
    {"Longitude [deg]", "longitude_deg"},
    {"Altitude [m]", "altitude_m"},
    {"Depth [m]", "depth_m"},
    {"Yaw [rad]", "heading_rad"},
    {"Pitch [rad]", "pitch_rad"},
    {"Roll [rad]", "roll_rad"},
    {"North SD [m]", "sigma_north_m"},
    {"East SD [m]", "sigma_east_m"},
    {"Depth SD [m]", "sigma_depth_m"},
    {"Yaw SD [rad]", "sigma_heading_rad"},
    {"Pitch SD [rad]", "sigma_pitch_rad"},
    {"Roll SD [rad]", "sigma_roll_rad"},
}};

std::string_view OurName(std::string_view name) {
  const auto alias = std::find_if(kAliases.begin(), kAliases.end(),
                                  [&](const Alias& a) { return a.theirs == name; });
  return alias == kAliases.end() ? name : alias->ours;
}

struct Row {
  std::array<double, kNumColumns> value{};
  std::array<double, kNumColumns> sigma{};  // 0: not stated
  std::array<bool, kNumColumns> is_there{};

  bool Has(std::initializer_list<Column> columns) const {
    return std::all_of(columns.begin(), columns.end(), [&](Column c) { return is_there[c]; });
  }
};

class NavTableReader {
 public:
  NavTableReader(const std::vector<ImageTime>& images, const std::optional<Geodetic>& origin) {
    for (const ImageTime& image : images) utime_of_image_[image.image] = image.utime;
    table_.origin = origin;
  }

  IoStatus Read(const std::filesystem::path& path);
  // One row, of the image that was taken then: the file's own times are not asked.
  IoStatus ReadOfImage(const std::filesystem::path& path, Utime utime);
  NavTable&& Take() { return std::move(table_); }

 private:
  IoStatus ReadHeader(const CsvTable& csv);
  IoStatus CheckTimeColumns(const CsvTable& csv) const;
  IoStatus CheckSigmaColumns(const CsvTable& csv) const;
  IoStatus CheckGroups(const CsvTable& csv) const;
  IoStatus ReadRow(const CsvRow& csv);
  bool HasColumn(Column column) const { return field_of_column_[column] >= 0; }
  IoStatus RequireTogether(const std::vector<Column>& columns) const;
  IoStatus ReadTime(const CsvRow& csv, Utime* utime) const;
  IoStatus ReadValues(const CsvRow& csv, Row* row) const;
  IoStatus SetPosition(const CsvRow& csv, const Row& row, NavSample* sample);
  IoStatus SetAttitude(const CsvRow& csv, const Row& row, NavSample* sample) const;
  tl::unexpected<Diagnostic> Problem(const CsvRow& csv, std::string_view column,
                                     std::string problem, std::string fix,
                                     Errc code = Errc::kInvalidArgument) const {
    return Fail({code, file_, "column " + std::string(column), std::move(problem), std::move(fix),
                 csv.line});
  }

  std::string file_;
  std::map<std::string, Utime, std::less<>> utime_of_image_;
  NavTable table_;
  std::optional<LocalFrame> frame_;
  std::optional<Utime> utime_of_file_;  // else of its rows
  int utime_field_ = -1, image_field_ = -1, date_time_field_ = -1;
  std::array<int, kNumColumns> field_of_column_{};  // -1: absent
  std::array<int, kNumColumns> field_of_sigma_{};
};

IoStatus NavTableReader::RequireTogether(const std::vector<Column>& columns) const {
  const auto is_there = [&](Column column) { return HasColumn(column); };
  if (std::none_of(columns.begin(), columns.end(), is_there)) return {};
  for (const Column column : columns) {
    if (HasColumn(column)) continue;
    return Fail({Errc::kInvalidArgument, file_, "column " + std::string(kColumns[column].name),
                 "is missing, though others of its group are there", "add it, or remove the others",
                 1});
  }
  return {};
}

IoStatus NavTableReader::ReadHeader(const CsvTable& csv) {
  utime_field_ = image_field_ = date_time_field_ = -1;
  field_of_column_.fill(-1);
  field_of_sigma_.fill(-1);
  std::vector<std::string_view> known = {"utime", "image"};
  for (const ColumnInfo& column : kColumns) known.push_back(column.name);
  for (std::size_t i = 0; i < csv.columns.size(); ++i) {
    const std::string_view name = OurName(csv.columns[i]);
    const bool is_sigma = name.starts_with("sigma_");
    const std::string_view base = is_sigma ? name.substr(6) : name;
    const auto info = std::find_if(kColumns.begin(), kColumns.end(),
                                   [&](const ColumnInfo& c) { return c.name == base; });
    int* field = nullptr;
    if (info != kColumns.end()) {
      const auto column = static_cast<std::size_t>(info - kColumns.begin());
      field = is_sigma ? &field_of_sigma_[column] : &field_of_column_[column];
    } else if (name == "utime") {
      field = &utime_field_;
    } else if (name == "image") {
      field = &image_field_;
    } else if (name == kDateTime) {
      field = &date_time_field_;
    } else {
      const std::string_view nearest = NearestWord(base, known);
      return Fail({Errc::kInvalidArgument, file_, "column " + Quoted(name), "is not known",
                   nearest.empty() ? "remove it"
                                   : "did you mean '" + std::string(is_sigma ? "sigma_" : "") +
                                         std::string(nearest) + "'?",
                   csv.header_line});
    }
    if (*field >= 0) {
      return Fail(
          {Errc::kInvalidArgument, file_, "column " + Quoted(csv.columns[i]),
           "is there twice, once as " + Quoted(csv.columns[static_cast<std::size_t>(*field)]),
           "keep one of them", csv.header_line});
    }
    *field = static_cast<int>(i);
  }
  if (auto status = CheckTimeColumns(csv); !status) return status;
  if (auto status = CheckSigmaColumns(csv); !status) return status;
  return CheckGroups(csv);
}

IoStatus NavTableReader::CheckTimeColumns(const CsvTable& csv) const {
  const int num_times = (utime_field_ >= 0) + (image_field_ >= 0) + (date_time_field_ >= 0);
  if (utime_of_file_ || num_times == 1) return {};
  const std::string other = image_field_ >= 0 ? "image" : std::string(kDateTime);
  return Fail({Errc::kInvalidArgument, file_, "column utime",
               num_times == 0     ? "is missing"
               : utime_field_ < 0 ? "is not there, but both image and DateTime are"
                                  : "is there beside the column " + other,
               "give either utime (microseconds) or image", csv.header_line});
}

IoStatus NavTableReader::CheckSigmaColumns(const CsvTable& csv) const {
  // Of a place by latitude and longitude the sigmas may be in metres.
  const bool may_be_metric =
      HasColumn(kLatitude) && field_of_sigma_[kLatitude] < 0 && field_of_sigma_[kLongitude] < 0;
  for (std::size_t column = 0; column < kNumColumns; ++column) {
    if (field_of_sigma_[column] < 0 || field_of_column_[column] >= 0) continue;
    if (may_be_metric && (column == kNorth || column == kEast)) continue;
    return Fail(
        {Errc::kInvalidArgument, file_, "column sigma_" + std::string(kColumns[column].name),
         "is there without the column it belongs to", "add that, or remove this", csv.header_line});
  }
  return {};
}

IoStatus NavTableReader::CheckGroups(const CsvTable& csv) const {
  if ((HasColumn(kNorth) && HasColumn(kLatitude)) || (HasColumn(kRoll) && HasColumn(kQw))) {
    const bool is_position = HasColumn(kNorth) && HasColumn(kLatitude);
    return Fail({Errc::kInvalidArgument, file_,
                 is_position ? "column latitude_deg" : "column roll_rad",
                 "is there beside " + std::string(is_position ? "north_m" : "qw"),
                 "give one or the other", csv.header_line});
  }
  const std::vector<std::vector<Column>> groups = {
      {kNorth, kEast},      {kLatitude, kLongitude}, {kRoll, kPitch, kHeading},
      {kQw, kQx, kQy, kQz}, {kVx, kVy, kVz},         {kTemperature, kSalinity}};
  for (const std::vector<Column>& group : groups) {
    if (auto status = RequireTogether(group); !status) return status;
  }
  const auto needs_vertical = [&](Column horizontal, Column vertical) {
    return HasColumn(horizontal) && !HasColumn(vertical) && !HasColumn(kDepth);
  };
  for (const auto& [horizontal, vertical] : {std::pair{kNorth, kDown}, {kLatitude, kHeight}}) {
    if (!needs_vertical(horizontal, vertical)) continue;
    return Fail({Errc::kInvalidArgument, file_, "column " + std::string(kColumns[vertical].name),
                 "is missing", "add it, or depth_m, which then stands for it", csv.header_line});
  }
  return {};
}

IoStatus NavTableReader::ReadTime(const CsvRow& csv, Utime* utime) const {
  std::string_view column = utime_field_ >= 0 ? "utime" : "image";
  if (utime_of_file_) {
    *utime = *utime_of_file_;
  } else if (date_time_field_ >= 0) {
    column = kDateTime;
    const std::string_view text = csv.fields[static_cast<std::size_t>(date_time_field_)];
    const auto value = ParseDateTime(text);
    if (!value) {
      return Problem(csv, column, Quoted(text) + " is no date with a time",
                     "give it like 2019-05-17 08:03:21.250, UTC");
    }
    *utime = *value;
  } else if (utime_field_ >= 0) {
    const std::string_view text = csv.fields[static_cast<std::size_t>(utime_field_)];
    const auto value = ParseInteger(text);
    if (!value || !IsTime(*value)) {
      return Problem(csv, "utime", Quoted(text) + " is no time in whole microseconds",
                     "give microseconds since the epoch");
    }
    *utime = *value;
  } else {
    const std::string_view name = csv.fields[static_cast<std::size_t>(image_field_)];
    const auto found = utime_of_image_.find(name);
    if (found == utime_of_image_.end()) {
      return Problem(csv, "image", Quoted(name) + " is not among the images",
                     "give the name of one of the images whose times are known");
    }
    *utime = found->second;
  }
  if (!table_.samples.empty() && *utime < table_.samples.back().utime) {
    return Problem(csv, column,
                   "time runs backwards: " + std::to_string(*utime) + " after " +
                       std::to_string(table_.samples.back().utime),
                   "sort the table by time", Errc::kOutOfOrder);
  }
  return {};
}

IoStatus NavTableReader::ReadValues(const CsvRow& csv, Row* row) const {
  for (std::size_t column = 0; column < kNumColumns; ++column) {
    const ColumnInfo& info = kColumns[column];
    for (const bool is_sigma : {false, true}) {
      const int field = is_sigma ? field_of_sigma_[column] : field_of_column_[column];
      if (field < 0) continue;
      const std::string_view text = csv.fields[static_cast<std::size_t>(field)];
      if (text.empty()) continue;
      const std::string name = (is_sigma ? "sigma_" : "") + std::string(info.name);
      const auto value = ParseNumber(text);
      if (!value) {
        return Problem(csv, name, Quoted(text) + " is not a number",
                       "give a number, or leave the field empty");
      }
      if (!std::isfinite(*value)) {
        return Problem(csv, name, "is not finite: " + Quoted(text),
                       "leave the field empty where there is no measurement");
      }
      const bool is_in_range = is_sigma ? *value >= 0.0 : *value >= info.low && *value <= info.high;
      if (!is_in_range) {
        return Problem(csv, name, "is out of range: " + std::string(text),
                       is_sigma ? "give a standard deviation, 0 or more" : info.fix);
      }
      (is_sigma ? row->sigma : row->value)[column] = *value;
      if (!is_sigma) row->is_there[column] = true;
    }
  }
  return {};
}

IoStatus NavTableReader::SetPosition(const CsvRow& csv, const Row& row, NavSample* sample) {
  // Without a column of its own the vertical is the depth: below the surface, which is taken to be
  // at the origin's height where the table has latitudes.
  if (row.Has({kNorth, kEast})) {
    const Column vertical = HasColumn(kDown) ? kDown : kDepth;
    if (!row.is_there[vertical]) return {};
    sample->position_ned_m = {row.value[kNorth], row.value[kEast], row.value[vertical]};
    sample->sigma_position_m = {row.sigma[kNorth], row.sigma[kEast], row.sigma[vertical]};
    sample->Set(NavField::kPosition);
    return {};
  }
  if (!row.Has({kLatitude, kLongitude})) return {};
  const bool has_height = HasColumn(kHeight);
  if (!row.is_there[has_height ? kHeight : kDepth]) return {};
  Geodetic place{row.value[kLatitude], row.value[kLongitude], 0.0};
  if (place.longitude_deg > 180.0) place.longitude_deg -= 360.0;
  if (!table_.origin) {
    table_.origin = place;
    if (has_height) table_.origin->height_m = row.value[kHeight];
  }
  if (!frame_) {
    auto frame = LocalFrame::Create(*table_.origin);
    if (!frame) {
      return Problem(csv, frame.error().where, "gives no local frame", "give a place on earth");
    }
    frame_ = *frame;
  }
  place.height_m = has_height ? row.value[kHeight] : table_.origin->height_m;
  sample->position_ned_m = frame_->NedFromGeodetic(place);
  if (!has_height) sample->position_ned_m.z() = row.value[kDepth];
  constexpr double kStepDeg = 1e-4;
  const auto metres_per_degree = [&](double latitude_step, double longitude_step) {
    const Geodetic moved{place.latitude_deg - std::copysign(latitude_step, place.latitude_deg),
                         place.longitude_deg - std::copysign(longitude_step, place.longitude_deg),
                         place.height_m};
    return (frame_->NedFromGeodetic(moved) - frame_->NedFromGeodetic(place)).norm() / kStepDeg;
  };
  sample->sigma_position_m = {row.sigma[kLatitude] * metres_per_degree(kStepDeg, 0.0),
                              row.sigma[kLongitude] * metres_per_degree(0.0, kStepDeg),
                              row.sigma[has_height ? kHeight : kDepth]};
  if (field_of_sigma_[kNorth] >= 0) sample->sigma_position_m.x() = row.sigma[kNorth];
  if (field_of_sigma_[kEast] >= 0) sample->sigma_position_m.y() = row.sigma[kEast];
  sample->Set(NavField::kPosition);
  return {};
}

IoStatus NavTableReader::SetAttitude(const CsvRow& csv, const Row& row, NavSample* sample) const {
  if (row.Has({kRoll, kPitch, kHeading})) {
    sample->ned_from_body =
        QuatFromRollPitchHeading(row.value[kRoll], row.value[kPitch], row.value[kHeading]);
    // A small roll turns about the body's forward axis, a small pitch about the level axis to the
    // right, a small heading about down; the three are independent.
    const Vec3 forward = sample->ned_from_body * Vec3::UnitX();
    const Vec3 right = QuatFromRollPitchHeading(0.0, 0.0, row.value[kHeading]) * Vec3::UnitY();
    sample->sigma_attitude_rad =
        ((forward * row.sigma[kRoll]).cwiseAbs2() + (right * row.sigma[kPitch]).cwiseAbs2() +
         (Vec3::UnitZ() * row.sigma[kHeading]).cwiseAbs2())
            .cwiseSqrt();
    sample->Set(NavField::kAttitude);
  } else if (row.Has({kQw, kQx, kQy, kQz})) {
    const Quat q(row.value[kQw], row.value[kQx], row.value[kQy], row.value[kQz]);
    if (std::abs(q.norm() - 1.0) > 1e-3) {
      return Problem(csv, "qw", "the quaternion's length is " + FormatNumber(q.norm()), kUnitFix);
    }
    sample->ned_from_body = q.normalized();
    // The vector part of a small rotation's quaternion is half its angle.
    sample->sigma_attitude_rad = 2.0 * Vec3(row.sigma[kQx], row.sigma[kQy], row.sigma[kQz]);
    sample->Set(NavField::kAttitude);
  }
  return {};
}

IoStatus NavTableReader::ReadRow(const CsvRow& csv) {
  NavSample sample;
  Row row;
  if (auto status = ReadTime(csv, &sample.utime); !status) return status;
  if (auto status = ReadValues(csv, &row); !status) return status;
  if (auto status = SetPosition(csv, row, &sample); !status) return status;
  if (auto status = SetAttitude(csv, row, &sample); !status) return status;
  if (row.Has({kVx, kVy, kVz})) {
    sample.velocity_body_mps = {row.value[kVx], row.value[kVy], row.value[kVz]};
    sample.sigma_velocity_mps = {row.sigma[kVx], row.sigma[kVy], row.sigma[kVz]};
    sample.Set(NavField::kVelocity);
  }
  if (row.is_there[kDepth]) {
    sample.depth_m = row.value[kDepth];
    sample.sigma_depth_m = row.sigma[kDepth];
    sample.Set(NavField::kDepth);
  }
  if (row.is_there[kAltitude]) {
    sample.altitude_m = row.value[kAltitude];
    sample.sigma_altitude_m = row.sigma[kAltitude];
    sample.Set(NavField::kAltitude);
  }
  if (row.Has({kTemperature, kSalinity})) {
    sample.temperature_c = row.value[kTemperature];
    sample.salinity_psu = row.value[kSalinity];
    sample.Set(NavField::kWater);
  }
  if (sample.valid != 0) table_.samples.push_back(sample);
  return {};
}

IoStatus NavTableReader::Read(const std::filesystem::path& path) {
  file_ = path.string();
  const auto csv = ReadCsv(path);
  if (!csv) return Fail(csv.error());
  if (auto status = ReadHeader(*csv); !status) return status;
  for (const CsvRow& row : csv->rows) {
    if (auto status = ReadRow(row); !status) return status;
  }
  return {};
}

IoStatus NavTableReader::ReadOfImage(const std::filesystem::path& path, Utime utime) {
  file_ = path.string();
  utime_of_file_ = utime;
  const auto csv = ReadCsv(path);
  if (!csv) return Fail(csv.error());
  if (csv->rows.size() != 1) {
    return Fail({Errc::kInvalidArgument, file_, "",
                 "has " + std::to_string(csv->rows.size()) + " rows, and stands for one image",
                 "give one row, or one table for all images"});
  }
  if (auto status = ReadHeader(*csv); !status) return status;
  return ReadRow(csv->rows.front());
}

// A file for each image, named as the image is.
IoStatus ReadNavFolder(const std::filesystem::path& folder, const std::vector<ImageTime>& images,
                       NavTableReader* reader) {
  std::size_t num_files = 0;
  for (const ImageTime& image : images) {
    const std::filesystem::path path = (folder / image.image).replace_extension(".csv");
    std::error_code error;
    if (!std::filesystem::exists(path, error)) continue;
    ++num_files;
    if (auto status = reader->ReadOfImage(path, image.utime); !status) return status;
  }
  if (num_files > 0) return {};
  return Fail({Errc::kInvalidArgument, folder.string(), "",
               "has no navigation of any of the " + std::to_string(images.size()) + " images",
               "give a table, or a folder with a file NAME.csv for each image NAME.jpg"});
}

}  // namespace

Quat QuatFromRollPitchHeading(double roll_rad, double pitch_rad, double heading_rad) {
  return Quat(Eigen::AngleAxisd(heading_rad, Vec3::UnitZ()) *
              Eigen::AngleAxisd(pitch_rad, Vec3::UnitY()) *
              Eigen::AngleAxisd(roll_rad, Vec3::UnitX()));
}

Vec3 RollPitchHeading(const Quat& ned_from_body) {
  const Mat3 r = ned_from_body.toRotationMatrix();
  return {std::atan2(r(2, 1), r(2, 2)), std::asin(std::clamp(-r(2, 0), -1.0, 1.0)),
          std::atan2(r(1, 0), r(0, 0))};
}

IoExpected<NavTable> ReadNavTable(const std::filesystem::path& path,
                                  const std::vector<ImageTime>& images,
                                  const std::optional<Geodetic>& origin) {
  NavTableReader reader(images, origin);
  std::error_code error;
  const IoStatus status = std::filesystem::is_directory(path, error)
                              ? ReadNavFolder(path, images, &reader)
                              : reader.Read(path);
  if (!status) return Fail(status.error());
  return reader.Take();
}

}  // namespace rsfm

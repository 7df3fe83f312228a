#include <functional>

#include "rsfm/io/atomic_output.h"
#include "rsfm/io/tables.h"
#include "rsfm/io/text.h"

namespace rsfm {
namespace {

// A group of columns that is there or not as a whole.
struct Group {
  NavField field;
  const char* names;
  const char* sigma_names;
  std::function<std::vector<double>(const NavSample&)> values;
  std::function<std::vector<double>(const NavSample&)> sigmas;
};

std::vector<double> Elements(const Vec3& v) { return {v.x(), v.y(), v.z()}; }

std::vector<Group> Groups() {
  return {
      {NavField::kPosition, "north_m,east_m,down_m", "sigma_north_m,sigma_east_m,sigma_down_m",
       [](const NavSample& s) { return Elements(s.position_ned_m); },
       [](const NavSample& s) { return Elements(s.sigma_position_m); }},
      {NavField::kAttitude, "qw,qx,qy,qz", "sigma_qx,sigma_qy,sigma_qz",
       [](const NavSample& s) {
         const Quat& q = s.ned_from_body;
         return std::vector<double>{q.w(), q.x(), q.y(), q.z()};
       },
       [](const NavSample& s) { return Elements(0.5 * s.sigma_attitude_rad); }},
      {NavField::kVelocity, "vx_mps,vy_mps,vz_mps", "sigma_vx_mps,sigma_vy_mps,sigma_vz_mps",
       [](const NavSample& s) { return Elements(s.velocity_body_mps); },
       [](const NavSample& s) { return Elements(s.sigma_velocity_mps); }},
      {NavField::kDepth, "depth_m", "sigma_depth_m",
       [](const NavSample& s) { return std::vector<double>{s.depth_m}; },
       [](const NavSample& s) { return std::vector<double>{s.sigma_depth_m}; }},
      {NavField::kAltitude, "altitude_m", "sigma_altitude_m",
       [](const NavSample& s) { return std::vector<double>{s.altitude_m}; },
       [](const NavSample& s) { return std::vector<double>{s.sigma_altitude_m}; }},
      {NavField::kWater, "temperature_c,salinity_psu", "",
       [](const NavSample& s) {
         return std::vector<double>{s.temperature_c, s.salinity_psu};
       },
       [](const NavSample&) { return std::vector<double>{}; }},
  };
}

}  // namespace

IoStatus WriteNavTable(const std::vector<NavSample>& samples, const std::filesystem::path& path) {
  struct Used {
    Group group;
    bool has_sigmas;
  };
  std::vector<Used> used;
  for (Group& group : Groups()) {
    bool is_used = false, has_sigmas = false;
    for (const NavSample& sample : samples) {
      if (!sample.Has(group.field)) continue;
      is_used = true;
      for (const double sigma : group.sigmas(sample)) has_sigmas |= sigma > 0.0;
    }
    if (is_used) used.push_back({std::move(group), has_sigmas});
  }
  std::string text = "utime";
  for (const Used& u : used) {
    text += std::string(",") + u.group.names;
    if (u.has_sigmas) text += std::string(",") + u.group.sigma_names;
  }
  text += "\n";
  for (const NavSample& sample : samples) {
    text += std::to_string(sample.utime);
    for (const Used& u : used) {
      std::vector<double> fields = u.group.values(sample);
      if (u.has_sigmas) {
        for (const double sigma : u.group.sigmas(sample)) fields.push_back(sigma);
      }
      for (const double field : fields) {
        text += sample.Has(u.group.field) ? "," + FormatNumber(field) : std::string(",");
      }
    }
    text += "\n";
  }
  return WriteFileAtomically(path, text);
}

}  // namespace rsfm

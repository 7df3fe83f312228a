// A rig behind its port, and as those have it who leave the port out.
//
//   ablation_rigs RIG.yaml OUT RANGE_M
//
// writes OUT/exact.yaml (RIG as it is), OUT/pinhole.yaml (the perspective camera with OPENCV's
// distortion that fits best to points at RANGE_M: what a calibration under water finds),
// OUT/index.yaml (central: water begins at the camera's centre, at right angles to its axis, and
// nothing but its index is known) and, of a flat port, OUT/index_tilt.yaml (the same with the
// port's true normal). A central camera in the middle of a dome is one without a port.
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <string>

#include "rsfm/io/rig.h"
#include "tools/evaluation/distorted_best_fit.h"

namespace rsfm {
namespace {

constexpr double kNoDistance_m = 1e-7;

PortConfig Central(const PortConfig& port, const Vec3& normal) {
  PortConfig central;
  if (port.type != PortType::kFlat) return central;
  central.type = PortType::kFlat;
  central.normal = normal;
  central.distance_m = kNoDistance_m;
  central.thickness_m = kNoDistance_m;
  central.index_glass = central.index_water = port.index_water;
  return central;
}

bool Write(const Rig& rig, const CameraConfig& camera, const std::filesystem::path& path) {
  Rig written = rig;
  written.camera = camera;
  const IoStatus status = WriteRig(written, path);
  if (!status) std::fprintf(stderr, "%s\n", ToString(status.error()).c_str());
  return status.has_value();
}

int Run(const std::string& rig_file, const std::filesystem::path& out, double range_m) {
  const auto rig = ReadRig(rig_file);
  if (!rig) return std::fprintf(stderr, "%s\n", ToString(rig.error()).c_str()), 1;
  const auto camera = AnyCamera::Create(rig->camera);
  const auto pinhole = camera ? FitWithDistortion(*camera, range_m) : std::nullopt;
  if (!pinhole)
    return std::fprintf(stderr, "error: %s: no perspective fits at %g m\n", rig_file.c_str(),
                        range_m),
           1;
  std::filesystem::create_directories(out);
  CameraConfig index = rig->camera, tilt = rig->camera;
  index.port = Central(rig->camera.port, Vec3::UnitZ());
  tilt.port = Central(rig->camera.port, rig->camera.port.normal);
  const bool ok =
      Write(*rig, rig->camera, out / "exact.yaml") &&
      Write(*rig, pinhole->config(), out / "pinhole.yaml") &&
      Write(*rig, index, out / "index.yaml") &&
      (rig->camera.port.type != PortType::kFlat || Write(*rig, tilt, out / "index_tilt.yaml"));
  return ok ? 0 : 1;
}

}  // namespace
}  // namespace rsfm

int main(int argc, char** argv) {
  const double range_m = argc == 4 ? std::atof(argv[3]) : 0.0;
  if (!(range_m > 0.0)) {
    std::fprintf(stderr, "usage: ablation_rigs RIG.yaml OUT RANGE_M\n");
    return 2;
  }
  return rsfm::Run(argv[1], argv[2], range_m);
}

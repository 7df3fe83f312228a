// A mission whose log is anything: it is read, or refused with a reason; the model of what was read
// is whole.
#include "rsfm/io/mission.h"
#include "tests/fuzz/fuzz.h"

namespace {

constexpr char kRig[] =
    "camera: {model: PINHOLE, width: 640, height: 480, params: [500, 500, 320, 240]}\n"
    "port: {type: flat, normal: [0, 0, 1], distance_m: 0.02, thickness_m: 0.01, index_air: 1.0, "
    "index_glass: 1.5, index_water: 1.33}\n";

}  // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace rsfm;
  const std::filesystem::path folder = FuzzFolder() / "mission";
  std::filesystem::create_directories(folder);
  WriteFuzzFile(folder / kRigFile, kRig);
  WriteFuzzFile(folder / kEventsFile, AsText(data, size));
  const auto mission = ReadMission(folder);
  if (!mission) return 0;
  const Model model = ModelFromMission(*mission);
  for (const ModelPoint& point : model.points) Require(point.xyz.allFinite());
  return 0;
}

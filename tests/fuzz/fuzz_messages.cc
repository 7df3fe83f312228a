// Every message that a bus or a log may bring. The first byte chooses the type, the rest is the
// payload.
#include <cmath>

#include "rsfm/io/nav_messages.h"
#include "tests/fuzz/fuzz.h"

namespace rsfm {
namespace {

// What decodes, encodes to the same bytes.
template <class Message>
void RoundTrip(std::span<const std::uint8_t> data) {
  Message message;
  if (!Decode(data, &message)) return;
  std::vector<std::uint8_t> bytes;
  Require(Encode(message, &bytes) &&
          std::equal(bytes.begin(), bytes.end(), data.begin(), data.end()));
}

void ConvertAs(InputType type, Convention convention, std::span<const std::uint8_t> data) {
  NavConverter converter{Rig()};
  NavSample s;
  if (converter.Convert({"", type, convention}, data, &s) != NavDecode::kOk) return;
  Require(!s.Has(NavField::kPosition) || s.position_ned_m.allFinite());
  Require(!s.Has(NavField::kVelocity) || s.velocity_body_mps.allFinite());
  Require(!s.Has(NavField::kAttitude) || std::abs(s.ned_from_body.norm() - 1.0) < 1e-9);
  Require(!s.Has(NavField::kDepth) || std::isfinite(s.depth_m));
  Require(!s.Has(NavField::kAltitude) || std::isfinite(s.altitude_m));
}

}  // namespace
}  // namespace rsfm

int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  using namespace rsfm;
  if (size == 0) return 0;
  const std::span<const std::uint8_t> data(bytes + 1, size - 1);
  switch (bytes[0] % 21) {
    case 0:
      ConvertAs(InputType::kNav, Convention::kRsfm, data);
      break;
    case 1:
      ConvertAs(InputType::kDvl, Convention::kRsfm, data);
      break;
    case 2:
      ConvertAs(InputType::kAhrs, Convention::kRsfm, data);
      break;
    case 3:
      ConvertAs(InputType::kDepth, Convention::kRsfm, data);
      break;
    case 4:
      ConvertAs(InputType::kCtd, Convention::kRsfm, data);
      break;
    case 5:
      ConvertAs(InputType::kFix, Convention::kRsfm, data);
      break;
    case 6:
      ConvertAs(InputType::kBotCorePose, Convention::kLibbot, data);
      break;
    case 7:
      ConvertAs(InputType::kBotCorePose, Convention::kOpenHumanoids, data);
      break;
    case 8:
      RoundTrip<keyframe_t>(data);
      break;
    case 9:
      RoundTrip<landmarks_t>(data);
      break;
    case 10:
      RoundTrip<pose_t>(data);
      break;
    case 11:
      RoundTrip<status_t>(data);
      break;
    case 12:
      RoundTrip<dvl_t>(data);
      break;
    case 20:
      RoundTrip<keyframe_poses_t>(data);
      break;
    case 14:
      RoundTrip<water_t>(data);
      break;
    case 15:
      RoundTrip<nav_t>(data);
      break;
    case 16:
      RoundTrip<ahrs_t>(data);
      break;
    case 17:
      RoundTrip<fix_t>(data);
      break;
    case 18:
      RoundTrip<bot_core::pose_t>(data);
      break;
    case 19:
      RoundTrip<acfrlcm::auv_acfr_nav_t>(data);
      break;
    default:  // 13
      ConvertAs(InputType::kAcfrNav, Convention::kAcfr, data);
      break;
  }
  return 0;
}

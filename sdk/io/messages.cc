#include "rsfm/io/messages.h"

#include <algorithm>

namespace rsfm {
namespace {

// What lcm-gen's decoders do not check: that text lengths and array counts are possible before
// memory is taken for them. A message's layout is what lies before, between and behind those.
enum class Part : std::uint8_t {
  kBytes,  // that many bytes
  kText,   // int32 length with the closing zero, then the text
  kCount,  // int32 count of the arrays that follow
  kArray,  // the last count times that many bytes
};
struct Step {
  Part part;
  std::size_t bytes = 0;
};

constexpr std::size_t kHead = 8 + 8;  // fingerprint and utime

template <class Message>
struct Layout {
  static constexpr std::array<Step, 0> kSteps = {};  // of fixed size: the decoder checks that
};
template <>
struct Layout<dvl_t> {
  static constexpr std::array kSteps = {Step{Part::kBytes, kHead + 4 + 8 * (3 + 9 + 2)},
                                        Step{Part::kCount}, Step{Part::kArray, 8 + 8 + 1}};
};
template <>
struct Layout<pose_t> {
  static constexpr std::array kSteps = {Step{Part::kBytes, kHead}, Step{Part::kText},
                                        Step{Part::kText},
                                        Step{Part::kBytes, 8 * (3 + 4 + 3 + 36) + 4 * 4 + 1}};
};
template <>
struct Layout<status_t> {
  static constexpr std::array kSteps = {
      Step{Part::kBytes, kHead + 4 + 4}, Step{Part::kText},
      Step{Part::kBytes, 1 + 8 * 3 + 1 + 8 * 38 + 4 * 4 + 8 * 3 + 8 * 2}, Step{Part::kText}};
};
template <>
struct Layout<keyframe_t> {
  static constexpr std::array kSteps = {Step{Part::kBytes, kHead + 4},
                                        Step{Part::kText},
                                        Step{Part::kBytes, 8 * (4 + 3) + 4 + 4},
                                        Step{Part::kCount},
                                        Step{Part::kArray, 4 * 4},
                                        Step{Part::kBytes, 4 + 4},
                                        Step{Part::kCount},
                                        Step{Part::kArray, 1}};
};
template <>
struct Layout<keyframe_poses_t> {
  static constexpr std::array kSteps = {Step{Part::kBytes, kHead}, Step{Part::kCount},
                                        Step{Part::kArray, 4 + 7 * 8}};
};
template <>
struct Layout<landmarks_t> {
  static constexpr std::array kSteps = {Step{Part::kBytes, kHead}, Step{Part::kCount},
                                        Step{Part::kArray, 4 + 3 * 8 + 3}};
};

std::int32_t BigEndianInt32(const std::uint8_t* bytes) {
  return static_cast<std::int32_t>(static_cast<std::uint32_t>(bytes[0]) << 24 |
                                   static_cast<std::uint32_t>(bytes[1]) << 16 |
                                   static_cast<std::uint32_t>(bytes[2]) << 8 | bytes[3]);
}

bool FitsLayout(std::span<const std::uint8_t> data, std::span<const Step> steps) {
  std::size_t count = 0;
  for (const Step& step : steps) {
    std::size_t bytes = step.bytes;
    if (step.part == Part::kText || step.part == Part::kCount) {
      if (data.size() < 4) return false;
      const std::int32_t value = BigEndianInt32(data.data());
      data = data.subspan(4);
      if (value < (step.part == Part::kText ? 1 : 0)) return false;
      if (step.part == Part::kCount) count = static_cast<std::size_t>(value);
      bytes = step.part == Part::kText ? static_cast<std::size_t>(value) : 0;
    } else if (step.part == Part::kArray) {
      bytes = count * step.bytes;  // below 2^31 * 31: no overflow
    }
    if (bytes > data.size()) return false;
    // A text ends at its first zero.
    if (step.part == Part::kText && std::find(data.begin(), data.end(), 0) - data.begin() !=
                                        static_cast<std::ptrdiff_t>(bytes) - 1) {
      return false;
    }
    data = data.subspan(bytes);
  }
  return data.empty();
}

template <class Message>
bool HasConsistentCounts(const Message&) {
  return true;
}
bool HasConsistentCounts(const dvl_t& m) {
  const auto n = static_cast<std::size_t>(m.num_beams);
  return m.num_beams >= 0 && m.beam_range_m.size() == n && m.beam_velocity_mps.size() == n &&
         m.beam_valid.size() == n;
}
bool HasConsistentCounts(const keyframe_t& m) {
  const auto n = static_cast<std::size_t>(m.num_features);
  return m.num_features >= 0 && m.x_px.size() == n && m.y_px.size() == n && m.size_px.size() == n &&
         m.landmark_id.size() == n && m.descriptor_bytes >= 0 && m.num_descriptor_bytes >= 0 &&
         static_cast<std::int64_t>(m.num_features) * m.descriptor_bytes == m.num_descriptor_bytes &&
         m.descriptors.size() == static_cast<std::size_t>(m.num_descriptor_bytes);
}
bool HasConsistentCounts(const keyframe_poses_t& m) {
  const auto n = static_cast<std::size_t>(m.num);
  return m.num >= 0 && m.id.size() == n && m.qw.size() == n && m.qx.size() == n &&
         m.qy.size() == n && m.qz.size() == n && m.tx.size() == n && m.ty.size() == n &&
         m.tz.size() == n;
}
bool HasConsistentCounts(const landmarks_t& m) {
  const auto n = static_cast<std::size_t>(m.num);
  return m.num >= 0 && m.id.size() == n && m.x.size() == n && m.y.size() == n && m.z.size() == n &&
         m.r.size() == n && m.g.size() == n && m.b.size() == n;
}

}  // namespace

template <class Message>
bool Decode(std::span<const std::uint8_t> data, Message* message) {
  if (data.size() > kMaxMessageBytes) return false;
  if constexpr (!Layout<Message>::kSteps.empty()) {
    if (!FitsLayout(data, Layout<Message>::kSteps)) return false;
  }
  Message decoded;
  const int size = static_cast<int>(data.size());
  if (decoded.decode(data.data(), 0, size) != size || !HasConsistentCounts(decoded)) return false;
  *message = std::move(decoded);
  return true;
}

template <class Message>
bool Encode(const Message& message, std::vector<std::uint8_t>* buffer) {
  if (!HasConsistentCounts(message)) return false;
  const int size = message.getEncodedSize();
  if (size < 0 || static_cast<std::size_t>(size) > kMaxMessageBytes) return false;
  buffer->resize(static_cast<std::size_t>(size));
  return message.encode(buffer->data(), 0, size) == size;
}

#define RSFM_INSTANTIATE(Message)                                     \
  template bool Decode(std::span<const std::uint8_t> data, Message*); \
  template bool Encode(const Message&, std::vector<std::uint8_t>* buffer)
RSFM_INSTANTIATE(acfrlcm::auv_acfr_nav_t);
RSFM_INSTANTIATE(ahrs_t);
RSFM_INSTANTIATE(bot_core::pose_t);
RSFM_INSTANTIATE(ctd_t);
RSFM_INSTANTIATE(depth_t);
RSFM_INSTANTIATE(dvl_t);
RSFM_INSTANTIATE(fix_t);
RSFM_INSTANTIATE(keyframe_poses_t);
RSFM_INSTANTIATE(keyframe_t);
RSFM_INSTANTIATE(landmarks_t);
RSFM_INSTANTIATE(nav_t);
RSFM_INSTANTIATE(pose_t);
RSFM_INSTANTIATE(status_t);
RSFM_INSTANTIATE(water_t);
#undef RSFM_INSTANTIATE

}  // namespace rsfm

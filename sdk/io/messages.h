// rsfm's LCM messages, and the foreign ones that are read here: checked encoding and decoding.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "acfrlcm/auv_acfr_nav_t.hpp"
#include "bot_core/pose_t.hpp"
#include "rsfm/ahrs_t.hpp"
#include "rsfm/ctd_t.hpp"
#include "rsfm/depth_t.hpp"
#include "rsfm/dvl_t.hpp"
#include "rsfm/fix_t.hpp"
#include "rsfm/keyframe_poses_t.hpp"
#include "rsfm/keyframe_t.hpp"
#include "rsfm/landmarks_t.hpp"
#include "rsfm/nav_t.hpp"
#include "rsfm/pose_t.hpp"
#include "rsfm/status_t.hpp"
#include "rsfm/water_t.hpp"

namespace rsfm {

inline constexpr std::size_t kMaxMessageBytes = std::size_t{1} << 28;

// False, and *message untouched, unless `data` is one whole message of this type: fingerprint,
// counts that fit, and not a byte too few or too many. Never allocates more than the data's size
// justifies, whatever its counts say.
template <class Message>
bool Decode(std::span<const std::uint8_t> data, Message* message);

// Reuses the buffer's memory. False, and nothing meaningful in it, when the arrays of the message
// do not have the length that its count says.
template <class Message>
bool Encode(const Message& message, std::vector<std::uint8_t>* buffer);

}  // namespace rsfm

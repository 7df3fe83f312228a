// The similarity or rigid transform that lays one trajectory over another.
#pragma once

#include <optional>
#include <span>
#include <string_view>

#include "rsfm/base/error.h"
#include "rsfm/base/rigid3.h"

namespace rsfm {

enum class Alignment : std::uint8_t { kNone, kYaw, kSe3, kSim3 };

// "none", "yaw", "se3" or "sim3".
std::optional<Alignment> AlignmentNamed(std::string_view name);
// In words: "rotation and translation".
const char* Describe(Alignment alignment);

struct Similarity {
  double scale = 1.0;
  Rigid3 transform;  // to_from: to = scale * R * from + t

  Vec3 operator*(const Vec3& point) const {
    return scale * (transform.rotation * point) + transform.translation;
  }
};

// Least squares of |to_i - (s R from_i + t)|^2, in closed form; s = 1 but for kSim3. kYaw turns
// about z alone, which is down on both sides: what a navigator may align, as attitude and depth are
// sensed.
//   [Umeyama 1991, IEEE PAMI 13(4), eqs. (40)-(42); Zhang & Scaramuzza 2018, IROS, sec. III-B]
// kNotEnoughData below three pairs; kDegenerate where one side is a single point, or a line: its
// rotation about itself is not determined.
Expected<Similarity> AlignPoints(std::span<const Vec3> from, std::span<const Vec3> to,
                                 Alignment alignment);

// The same for poses: the rotation comes from the attitudes where the positions lie on a line, so
// that a straight track can be compared as well. Transforms are world_from_camera.
//   kDegenerate  all positions are one point and the scale is asked for
Expected<Similarity> AlignPoses(std::span<const Rigid3> from, std::span<const Rigid3> to,
                                Alignment alignment);

}  // namespace rsfm

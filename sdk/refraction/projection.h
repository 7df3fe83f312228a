// How a projection or back-projection ended.
#pragma once

#include <cstdint>
#include <string_view>

namespace rsfm {

enum class Projection : std::uint8_t {
  kOk,
  kBehindLens,               // the direction in air is outside what the lens model maps (behind it)
  kOutsideLensDomain,        // the distortion is not monotone there, or the pixel has no direction
  kBehindPort,               // the point is on the camera's side of the port
  kInsideGlass,              // the point lies within the glass
  kTotalInternalReflection,  // no light path: the ray would be reflected, not refracted
  kOutsideDome,              // the ray misses the dome (the camera centre is not inside it)
  kOutsideImage,             // a pixel outside the image, where the caller asked for one inside
  kNotFinite,                // an input is NaN or infinite
};

// snake_case names for people and files: "behind_port".
std::string_view ToString(Projection status) noexcept;

}  // namespace rsfm

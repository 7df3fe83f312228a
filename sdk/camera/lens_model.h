// The names and numbers of the lens models, as COLMAP has them.
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

namespace rsfm {

inline constexpr int kMaxLensParams = 16;

// The value is COLMAP's model id.
enum class LensModel : std::int32_t {
  kPinhole = 1,
  kSimpleRadial = 2,
  kOpenCV = 4,
  kOpenCVFisheye = 5,
};

std::string_view ToString(LensModel model) noexcept;  // COLMAP's name, "OPENCV"
std::optional<LensModel> LensModelFromName(std::string_view name) noexcept;
std::optional<LensModel> LensModelFromColmapId(std::int32_t id) noexcept;
int NumLensParams(LensModel model) noexcept;
std::string_view LensParamNames(LensModel model) noexcept;  // "fx fy cx cy k1 k2 p1 p2"
// Positions of the parameters that are focal lengths (1 or 2), principal point (2), the rest being
// distortion.
int NumFocalLengths(LensModel model) noexcept;

}  // namespace rsfm

// The names and numbers of the lens models, as COLMAP has them.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

namespace rsfm {

inline constexpr int kMaxLensParams = 16;

// The value is COLMAP's model id.
enum class LensModel : std::int32_t {
  kSimplePinhole = 0,
  kPinhole = 1,
  kSimpleRadial = 2,
  kRadial = 3,
  kOpenCV = 4,
  kOpenCVFisheye = 5,
  kFullOpenCV = 6,
  kFov = 7,
  kSimpleRadialFisheye = 8,
  kRadialFisheye = 9,
  kThinPrismFisheye = 10,
  kRadTanThinPrismFisheye = 11,
  kSimpleDivision = 12,
  kDivision = 13,
  kSimpleFisheye = 14,
  kFisheye = 15,
  kEucm = 16,
  kMetashapeFisheye = 1000,  // colmap_underwater's; COLMAP itself has no such model
};

std::span<const LensModel> AllLensModels() noexcept;
std::string_view ToString(LensModel model) noexcept;  // COLMAP's name, "OPENCV"
std::optional<LensModel> LensModelFromName(std::string_view name) noexcept;
std::optional<LensModel> LensModelFromColmapId(std::int32_t id) noexcept;
int NumLensParams(LensModel model) noexcept;
// The parameters' names, in order and separated by blanks: "fx fy cx cy k1 k2 p1 p2".
std::string_view LensParamNames(LensModel model) noexcept;
// Focal lengths come first (1 or 2), then the principal point (2), then the distortion.
int NumFocalLengths(LensModel model) noexcept;

}  // namespace rsfm

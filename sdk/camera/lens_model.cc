#include "rsfm/camera/lens_model.h"

#include <algorithm>
#include <array>

namespace rsfm {
namespace {

struct ModelFacts {
  LensModel model;
  std::string_view name;
  std::string_view param_names;
};

constexpr std::array kModels = {
    ModelFacts{LensModel::kSimplePinhole, "SIMPLE_PINHOLE", "f cx cy"},
    ModelFacts{LensModel::kPinhole, "PINHOLE", "fx fy cx cy"},
    ModelFacts{LensModel::kSimpleRadial, "SIMPLE_RADIAL", "f cx cy k"},
    ModelFacts{LensModel::kRadial, "RADIAL", "f cx cy k1 k2"},
    ModelFacts{LensModel::kOpenCV, "OPENCV", "fx fy cx cy k1 k2 p1 p2"},
    ModelFacts{LensModel::kOpenCVFisheye, "OPENCV_FISHEYE", "fx fy cx cy k1 k2 k3 k4"},
    ModelFacts{LensModel::kFullOpenCV, "FULL_OPENCV", "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6"},
    ModelFacts{LensModel::kFov, "FOV", "fx fy cx cy omega"},
    ModelFacts{LensModel::kSimpleRadialFisheye, "SIMPLE_RADIAL_FISHEYE", "f cx cy k"},
    ModelFacts{LensModel::kRadialFisheye, "RADIAL_FISHEYE", "f cx cy k1 k2"},
    ModelFacts{LensModel::kThinPrismFisheye, "THIN_PRISM_FISHEYE",
               "fx fy cx cy k1 k2 p1 p2 k3 k4 sx1 sy1"},
    ModelFacts{LensModel::kRadTanThinPrismFisheye, "RAD_TAN_THIN_PRISM_FISHEYE",
               "fx fy cx cy k0 k1 k2 k3 k4 k5 p0 p1 s0 s1 s2 s3"},
    ModelFacts{LensModel::kSimpleDivision, "SIMPLE_DIVISION", "f cx cy k"},
    ModelFacts{LensModel::kDivision, "DIVISION", "fx fy cx cy k"},
    ModelFacts{LensModel::kSimpleFisheye, "SIMPLE_FISHEYE", "f cx cy"},
    ModelFacts{LensModel::kFisheye, "FISHEYE", "fx fy cx cy"},
    ModelFacts{LensModel::kEucm, "EUCM", "fx fy cx cy alpha beta"},
    ModelFacts{LensModel::kMetashapeFisheye, "METASHAPE_FISHEYE", "fx fy cx cy k1 k2 k3 k4 p1 p2"},
};

constexpr std::array kIds = [] {
  std::array<LensModel, kModels.size()> ids{};
  for (std::size_t i = 0; i < kModels.size(); ++i) ids[i] = kModels[i].model;
  return ids;
}();

const ModelFacts* Find(LensModel model) {
  const auto* found = std::find_if(kModels.begin(), kModels.end(),
                                   [&](const ModelFacts& m) { return m.model == model; });
  return found == kModels.end() ? nullptr : found;
}

}  // namespace

std::span<const LensModel> AllLensModels() noexcept { return kIds; }

std::string_view ToString(LensModel model) noexcept {
  const ModelFacts* facts = Find(model);
  return facts != nullptr ? facts->name : "UNKNOWN";
}

std::optional<LensModel> LensModelFromName(std::string_view name) noexcept {
  for (const ModelFacts& facts : kModels) {
    if (facts.name == name) return facts.model;
  }
  return std::nullopt;
}

std::optional<LensModel> LensModelFromColmapId(std::int32_t id) noexcept {
  const auto model = static_cast<LensModel>(id);
  return Find(model) != nullptr ? std::optional(model) : std::nullopt;
}

int NumLensParams(LensModel model) noexcept {
  const std::string_view names = LensParamNames(model);
  return names.empty() ? 0 : static_cast<int>(std::count(names.begin(), names.end(), ' ')) + 1;
}

std::string_view LensParamNames(LensModel model) noexcept {
  const ModelFacts* facts = Find(model);
  return facts != nullptr ? facts->param_names : std::string_view();
}

int NumFocalLengths(LensModel model) noexcept {
  return LensParamNames(model).starts_with("fx fy") ? 2 : 1;
}

}  // namespace rsfm

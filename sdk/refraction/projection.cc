#include "rsfm/refraction/projection.h"

namespace rsfm {

std::string_view ToString(Projection status) noexcept {
  switch (status) {
    case Projection::kOk:
      return "ok";
    case Projection::kBehindLens:
      return "behind_lens";
    case Projection::kOutsideLensDomain:
      return "outside_lens_domain";
    case Projection::kBehindPort:
      return "behind_port";
    case Projection::kInsideGlass:
      return "inside_glass";
    case Projection::kTotalInternalReflection:
      return "total_internal_reflection";
    case Projection::kOutsideDome:
      return "outside_dome";
    case Projection::kOutsideImage:
      return "outside_image";
    case Projection::kNotFinite:
      return "not_finite";
  }
  return "unknown";
}

}  // namespace rsfm

#include "tools/offline/uwpinhole.h"

#include <algorithm>

#include "rsfm/refraction/any_camera.h"
#include "rsfm/refraction/best_fit.h"

namespace rsfm {

Expected<CameraConfig> DropPort(const CameraConfig& config) {
  if (config.port.type == PortType::kNone) return config;
  const auto camera = AnyCamera::Create(config);
  if (!camera) return tl::unexpected<Error>(camera.error());
  const auto fit = FitPerspective(*camera);
  if (!fit) return tl::unexpected<Error>(fit.error());
  CameraConfig result = config;
  result.port = PortConfig();
  const int num_focal = NumFocalLengths(config.lens);
  std::fill(result.lens_params.begin(), result.lens_params.end(), 0.0);
  result.lens_params[0] = num_focal == 1 ? 0.5 * (fit->fx + fit->fy) : fit->fx;
  if (num_focal == 2) result.lens_params[1] = fit->fy;
  result.lens_params[num_focal] = fit->cx;
  result.lens_params[num_focal + 1] = fit->cy;
  return result;
}

RefineLens RefineUwPinhole() {
  RefineLens lens;
  lens.focal = lens.principal_point = lens.distortion = true;
  lens.sigma_focal = 0.3;
  lens.sigma_principal_point = 0.1;
  lens.sigma_distortion = 1.0;
  return lens;
}

}  // namespace rsfm

#include "rsfm/io/calibmar.h"

#include "rsfm/io/text.h"

namespace rsfm {

IoExpected<std::string> FormatCalibmar(const CameraConfig& camera) {
  if (!camera.port.outer_layers.empty()) {
    return Fail({Errc::kUnsupported, "", "port.layers",
                 "a port of several layers has no place in calibmar's file",
                 "keep rig.yaml, or describe the port by one layer"});
  }
  const auto list = [](const auto& values) {
    std::string text = "[";
    for (const double value : values) text += (text.size() > 1 ? ", " : "") + FormatNumber(value);
    return text + "]";
  };
  std::string names(LensParamNames(camera.lens));
  for (std::size_t at = 0; (at = names.find(' ', at)) != std::string::npos; at += 2)
    names.replace(at, 1, ", ");
  std::string text = "model: " + std::string(ToString(camera.lens)) + "\n# " + names +
                     "\nparameters: " + list(camera.lens_params) + "\n";
  switch (camera.port.type) {
    case PortType::kNone:
      text += "non_svp_model: NONE\nnon_svp_parameters: []\n";
      break;
    case PortType::kFlat:
      text += "non_svp_model: FLATPORT\n# Nx, Ny, Nz, int_dist, int_thick, na, ng, nw\n";
      break;
    case PortType::kDome:
      text += "non_svp_model: DOMEPORT\n# Cx, Cy, Cz, int_radius, int_thick, na, ng, nw\n";
      break;
  }
  if (camera.port.type != PortType::kNone)
    text += "non_svp_parameters: " + list(camera.port.Params()) + "\n";
  return text + "width: " + std::to_string(camera.width) +
         "\nheight: " + std::to_string(camera.height) + "\n";
}

}  // namespace rsfm

// Random rigs, drawn from the bounds of the paper's evaluation: 1920 x 1080, 73 degrees of view.
#pragma once

#include "rsfm/base/rng.h"
#include "rsfm/refraction/any_camera.h"

namespace rsfm {

inline CameraConfig PaperLens() {
  CameraConfig config;
  config.lens = LensModel::kPinhole;
  config.width = 1920;
  config.height = 1080;
  config.lens_params = {1297.37, 1297.37, 960.0, 540.0};
  return config;
}

inline PortConfig RandomFlatPort(Rng* rng) {
  PortConfig port;
  port.type = PortType::kFlat;
  const double x = rng->Uniform(-0.2, 0.2), y = rng->Uniform(-0.2, 0.2), z = rng->Uniform(0.8, 1.2);
  port.normal = Vec3(x, y, z).normalized();
  port.distance_m = rng->Uniform(0.001, 0.05);
  port.thickness_m = rng->Uniform(0.002, 0.2);
  port.index_air = 1.0;
  port.index_glass = 1.52;
  port.index_water = 1.334;
  return port;
}

inline PortConfig RandomDomePort(Rng* rng) {
  PortConfig port;
  port.type = PortType::kDome;
  const double x = rng->Uniform(-0.01, 0.01), y = rng->Uniform(-0.01, 0.01),
               z = rng->Uniform(-0.03, 0.03);
  port.center_m = Vec3(x, y, z);
  port.radius_m = rng->Uniform(0.05, 0.07);
  port.thickness_m = rng->Uniform(0.005, 0.02);
  port.index_air = 1.0;
  port.index_glass = 1.52;
  port.index_water = 1.334;
  return port;
}

inline PortConfig CentredDomePort() {
  PortConfig port;
  port.type = PortType::kDome;
  port.radius_m = 0.06;
  port.thickness_m = 0.01;
  return port;
}

// Acrylic, a gap of air and glass: a housing's window behind a tank's.
inline PortConfig RandomLayeredPort(Rng* rng) {
  PortConfig port = RandomFlatPort(rng);
  port.thickness_m = rng->Uniform(0.002, 0.02);
  port.index_glass = 1.49;
  port.outer_layers = {{.thickness_m = rng->Uniform(0.001, 0.02), .index = 1.0},
                       {.thickness_m = rng->Uniform(0.0001, 0.001), .index = 1.4},
                       {.thickness_m = rng->Uniform(0.002, 0.02), .index = 1.52}};
  return port;
}

enum class RigKind { kNone, kFlat, kDome, kCentredDome, kLayered };

// A camera of the paper's evaluation behind a random port of the given kind.
inline AnyCamera RandomRig(RigKind kind, Rng* rng) {
  CameraConfig config = PaperLens();
  switch (kind) {
    case RigKind::kNone:
      break;
    case RigKind::kFlat:
      config.port = RandomFlatPort(rng);
      break;
    case RigKind::kDome:
      config.port = RandomDomePort(rng);
      break;
    case RigKind::kCentredDome:
      config.port = CentredDomePort();
      break;
    case RigKind::kLayered:
      config.port = RandomLayeredPort(rng);
      break;
  }
  return *AnyCamera::Create(config);
}

}  // namespace rsfm

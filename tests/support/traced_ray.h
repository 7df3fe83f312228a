// The plain way through a port, surface by surface with Snell's law in vector form, over any
// scalar: the reference that closed forms and their derivatives are compared with.
#pragma once

#include <array>
#include <vector>

#include "rsfm/refraction/camera_config.h"

namespace rsfm {

// PortParams and the layers outside the first, thickness and index of each, as scalars T.
template <class T>
struct PortNumbers {
  PortType type = PortType::kNone;
  std::array<T, kNumPortParams> port;
  std::vector<T> layers;

  explicit PortNumbers(const PortConfig& config) : type(config.type) {
    const PortParams params = config.Params();
    for (int i = 0; i < kNumPortParams; ++i) port[i] = T(params[i]);
    for (const PortLayer& layer : config.outer_layers) {
      layers.push_back(T(layer.thickness_m));
      layers.push_back(T(layer.index));
    }
  }
};

// False on total internal reflection, or where a surface is not met.
template <class T>
bool TraceRay(const PortNumbers<T>& numbers, const Vec3T<T>& in_air, Vec3T<T>* origin,
              Vec3T<T>* direction) {
  using std::sqrt;
  const bool is_flat = numbers.type == PortType::kFlat;
  std::vector<T> offsets{T(0.0), numbers.port[4]}, indices{numbers.port[5], numbers.port[6]};
  for (std::size_t i = 0; i < numbers.layers.size(); i += 2) {
    offsets.push_back(offsets.back() + numbers.layers[i]);
    indices.push_back(numbers.layers[i + 1]);
  }
  indices.push_back(numbers.port[7]);
  Vec3T<T> vector(numbers.port[0], numbers.port[1], numbers.port[2]);
  if (is_flat) vector = vector / sqrt(vector.dot(vector));
  Vec3T<T> from(T(0.0), T(0.0), T(0.0)), v = in_air;
  for (std::size_t i = 0; i < offsets.size(); ++i) {
    const T offset = numbers.port[3] + offsets[i];
    Vec3T<T> normal;
    if (is_flat) {
      const T cosine = vector.dot(v);
      if (!(cosine > T(0.0))) return false;
      from = from + v * ((offset - vector.dot(from)) / cosine);
      normal = vector;
    } else {
      const Vec3T<T> c = from - vector;
      const T b = c.dot(v), discriminant = b * b - c.dot(c) + offset * offset;
      if (!(discriminant > T(0.0))) return false;
      from = from + v * (sqrt(discriminant) - b);
      normal = (from - vector) / offset;
    }
    const T ratio = indices[i] / indices[i + 1], cosine = normal.dot(v);
    const T radicand = T(1.0) - ratio * ratio * (T(1.0) - cosine * cosine);
    if (!(radicand > T(0.0))) return false;
    v = Vec3T<T>(v * ratio + normal * (sqrt(radicand) - ratio * cosine));
  }
  *origin = from;
  *direction = v;
  return true;
}

}  // namespace rsfm

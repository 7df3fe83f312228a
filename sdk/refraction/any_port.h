// Any port, chosen at run time: flat, dome or none. A port like the others.
#pragma once

#include <variant>

#include "rsfm/refraction/dome_port.h"
#include "rsfm/refraction/flat_port.h"
#include "rsfm/refraction/no_port.h"

namespace rsfm {

class AnyPort {
 public:
  explicit AnyPort(const PortConfig& config) noexcept : port_(Make(config)) {}

  // f(the port), with its own type.
  template <class F>
  decltype(auto) Visit(F&& f) const {
    if (const auto* flat = std::get_if<FlatPort>(&port_)) return f(*flat);
    if (const auto* dome = std::get_if<DomePort>(&port_)) return f(*dome);
    return f(*std::get_if<NoPort>(&port_));
  }

  // Whether directions in air and in water may differ at all.
  bool IsNone() const noexcept { return std::holds_alternative<NoPort>(port_); }

  template <class... Out>
  Projection RefractToAir(const Vec3& point, Out*... out) const noexcept {
    return Visit([&](const auto& port) { return port.RefractToAir(point, out...); });
  }
  template <class... Out>
  Projection RefractToWater(const Vec3& direction, Out*... out) const noexcept {
    return Visit([&](const auto& port) { return port.RefractToWater(direction, out...); });
  }
  bool RefractToAir(PortBlock* block) const noexcept {
    return Visit([&](const auto& port) { return port.RefractToAir(block); });
  }
  bool RefractToWater(RayBlock* block) const noexcept {
    return Visit([&](const auto& port) { return port.RefractToWater(block); });
  }
  double RangeToAxis(const Vec3& direction, const Ray3& ray) const noexcept {
    return Visit([&](const auto& port) { return port.RangeToAxis(direction, ray); });
  }
  Vec3 Axis() const noexcept {
    return Visit([](const auto& port) { return port.Axis(); });
  }
  int NumOuterLayers() const noexcept {
    return Visit([](const auto& port) { return port.NumOuterLayers(); });
  }

 private:
  using Variant = std::variant<NoPort, FlatPort, DomePort>;
  static Variant Make(const PortConfig& config) noexcept {
    switch (config.type) {
      case PortType::kFlat:
        return FlatPort(config);
      case PortType::kDome:
        return DomePort(config);
      case PortType::kNone:
        break;
    }
    return NoPort(config);
  }

  Variant port_;
};
static_assert(Port<NoPort> && Port<FlatPort> && Port<DomePort> && Port<AnyPort>);

}  // namespace rsfm

// The paper's bundle adjustment residual, written plainly, as the baseline that rsfm is measured
// against: the error on the virtual image of the observed pixel, everything traced forward in
// ceres::Jet numbers.   [She 2024, arXiv:2403.08640, "Virtual Camera Computation", eqs. (1)-(2),
// and "Bundle Adjustment"]
#pragma once

#include <ceres/ceres.h>

#include "rsfm/base/linear.h"
#include "rsfm/refraction/camera_config.h"

namespace rsfm::paper {

template <class T>
using V2 = Eigen::Matrix<T, 2, 1>;
template <class T>
using V3 = Eigen::Matrix<T, 3, 1>;

// PINHOLE (4 parameters) or OPENCV (8), behind a flat or a dome port.
template <int kLens, PortType kPort>
class VirtualError {
 public:
  explicit VirtualError(const Vec2& pixel) : pixel_(pixel) {}

  static ceres::CostFunction* Create(const Vec2& pixel) {
    return new ceres::AutoDiffCostFunction<VirtualError, 2, 4, 3, 3, kLens, kNumPortParams>(
        new VirtualError(pixel));
  }

  template <class T>
  bool operator()(const T* q, const T* t, const T* x, const T* lens, const T* port,
                  T* residual) const {
    V3<T> origin, direction, axis;
    Trace(lens, port, &origin, &direction, &axis);
    // The virtual centre: where the ray in water comes nearest to the refraction axis.
    const T da = direction.dot(axis), offset = origin.dot(axis) - origin.dot(direction) * da;
    const V3<T> center = axis * (offset / (T(1.0) - da * da));
    const T focal = (lens[0] + lens[1]) * T(0.5);
    const V2<T> principal =
        pixel_.cast<T>() - direction.template head<2>() * (focal / direction.z());
    const V3<T> p = Eigen::Map<const Eigen::Quaternion<T>>(q) * Eigen::Map<const V3<T>>(x) +
                    Eigen::Map<const V3<T>>(t) - center;
    residual[0] = focal * p.x() / p.z() + principal.x() - T(pixel_.x());
    residual[1] = focal * p.y() / p.z() + principal.y() - T(pixel_.y());
    return true;
  }

 private:
  template <class T>
  static V3<T> Snell(const V3<T>& v, const V3<T>& n, const T& ratio) {
    using std::sqrt;
    const T c = n.dot(v);
    return v * ratio - n * (ratio * c - sqrt(T(1.0) - ratio * ratio * (T(1.0) - c * c)));
  }

  template <class T>
  static V2<T> Distort(const T* k, const V2<T>& p) {
    const T r2 = p.squaredNorm(), radial = k[4] * r2 + k[5] * r2 * r2;
    return {p.x() + p.x() * radial + T(2.0) * k[6] * p.x() * p.y() +
                k[7] * (r2 + T(2.0) * p.x() * p.x()),
            p.y() + p.y() * radial + T(2.0) * k[7] * p.x() * p.y() +
                k[6] * (r2 + T(2.0) * p.y() * p.y())};
  }

  template <class T>
  static V2<T> Undistort(const T* k, const V2<T>& q) {
    V2<T> p = q;
    for (int i = 0; i < 100; ++i) {
      const T h(1e-6);
      Eigen::Matrix<T, 2, 2> jacobian;
      jacobian.col(0) =
          (Distort<T>(k, p + V2<T>(h, T(0))) - Distort<T>(k, p - V2<T>(h, T(0)))) / (T(2.0) * h);
      jacobian.col(1) =
          (Distort<T>(k, p + V2<T>(T(0), h)) - Distort<T>(k, p - V2<T>(T(0), h))) / (T(2.0) * h);
      const V2<T> step = jacobian.inverse() * (Distort<T>(k, p) - q);
      p -= step;
      if (step.squaredNorm() < T(1e-20)) break;
    }
    return p;
  }

  template <class T>
  void Trace(const T* lens, const T* port, V3<T>* origin, V3<T>* direction, V3<T>* axis) const {
    using std::sqrt;
    V2<T> p((T(pixel_.x()) - lens[2]) / lens[0], (T(pixel_.y()) - lens[3]) / lens[1]);
    if constexpr (kLens == 8) p = Undistort<T>(lens, p);
    const V3<T> v = V3<T>(p.x(), p.y(), T(1.0)).normalized();
    const V3<T> place(port[0], port[1], port[2]);
    const T glass_ratio = port[5] / port[6], water_ratio = port[6] / port[7];
    if constexpr (kPort == PortType::kFlat) {
      *axis = place.normalized();
      const V3<T> inner = v * (port[3] / axis->dot(v));
      const V3<T> glass = Snell<T>(v, *axis, glass_ratio);
      *origin = inner + glass * (port[4] / axis->dot(glass));
      *direction = Snell<T>(glass, *axis, water_ratio).normalized();
    } else {
      const auto meet = [&place](const V3<T>& from, const V3<T>& along, const T& radius) {
        const V3<T> c = from - place;
        const T b = c.dot(along);
        return V3<T>(from + along * (sqrt(b * b - c.squaredNorm() + radius * radius) - b));
      };
      *axis = place.normalized();
      const V3<T> inner = meet(V3<T>(T(0), T(0), T(0)), v, port[3]);
      const V3<T> glass = Snell<T>(v, (inner - place).normalized(), glass_ratio);
      *origin = meet(inner, glass, port[3] + port[4]);
      *direction = Snell<T>(glass, (*origin - place).normalized(), water_ratio).normalized();
    }
  }

  Vec2 pixel_;
};

}  // namespace rsfm::paper

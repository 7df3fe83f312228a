// The paper's way of projecting through a port, written plainly, as the baseline that rsfm is
// measured against: a two-dimensional Newton search for the pixel whose traced ray meets the point,
// derivatives by differences; the lens is undistorted by Newton with numeric derivatives.   [She
// 2024, arXiv:2403.08640, sec. III; the search as described there]
#pragma once

#include <cmath>

#include "rsfm/base/ray3.h"
#include "rsfm/refraction/camera_config.h"

namespace rsfm::paper {

struct Camera {
  CameraConfig config;

  // OpenCV's radial and tangential distortion; no coefficients for PINHOLE.
  Vec2 Distort(const Vec2& p) const {
    if (config.lens == LensModel::kPinhole) return p;
    const auto& k = config.lens_params;
    const double x = p.x(), y = p.y(), r2 = x * x + y * y, radial = k[4] * r2 + k[5] * r2 * r2;
    return {x + x * radial + 2 * k[6] * x * y + k[7] * (r2 + 2 * x * x),
            y + y * radial + 2 * k[7] * x * y + k[6] * (r2 + 2 * y * y)};
  }

  Vec2 Undistort(const Vec2& q) const {
    if (config.lens == LensModel::kPinhole) return q;
    Vec2 p = q;
    for (int i = 0; i < 100; ++i) {
      const double hx = std::max(1e-10, std::abs(1e-6 * p.x())),
                   hy = std::max(1e-10, std::abs(1e-6 * p.y()));
      const Vec2 value = Distort(p);
      Mat2 jacobian;
      jacobian.col(0) = (Distort(p + Vec2(hx, 0)) - Distort(p - Vec2(hx, 0))) / (2 * hx);
      jacobian.col(1) = (Distort(p + Vec2(0, hy)) - Distort(p - Vec2(0, hy))) / (2 * hy);
      const Vec2 step = jacobian.inverse() * (value - q);
      p -= step;
      if (step.squaredNorm() < 1e-20) break;
    }
    return p;
  }

  Vec3 Unproject(const Vec2& pixel) const {
    const auto& k = config.lens_params;
    const Vec2 p = Undistort({(pixel.x() - k[2]) / k[0], (pixel.y() - k[3]) / k[1]});
    return Vec3(p.x(), p.y(), 1.0).normalized();
  }

  static Vec3 Snell(const Vec3& v, const Vec3& n, double ratio) {
    const double c = n.dot(v);
    return ratio * v - (ratio * c - std::sqrt(1 - ratio * ratio * (1 - c * c))) * n;
  }

  Ray3 Backproject(const Vec2& pixel) const {
    const PortConfig& port = config.port;
    const Vec3 v = Unproject(pixel);
    if (port.type == PortType::kFlat) {
      const Vec3 inner = v * (port.distance_m / port.normal.dot(v));
      const Vec3 glass = Snell(v, port.normal, port.index_air / port.index_glass);
      const Vec3 outer = inner + glass * (port.thickness_m / port.normal.dot(glass));
      return {outer, Snell(glass, port.normal, port.index_glass / port.index_water).normalized()};
    }
    const auto meet = [&](const Vec3& from, const Vec3& direction, double radius) -> Vec3 {
      const Vec3 c = from - port.center_m;
      const double b = c.dot(direction);
      return from + direction * (std::sqrt(b * b - c.squaredNorm() + radius * radius) - b);
    };
    const Vec3 inner = meet(Vec3::Zero(), v, port.radius_m);
    const Vec3 glass =
        Snell(v, (inner - port.center_m).normalized(), port.index_air / port.index_glass);
    const Vec3 outer = meet(inner, glass, port.radius_m + port.thickness_m);
    return {outer,
            Snell(glass, (outer - port.center_m).normalized(), port.index_glass / port.index_water)
                .normalized()};
  }

  // Finds the pixel whose ray, taken to the point's depth, meets the point.
  Vec2 Project(const Vec3& point) const {
    const auto& k = config.lens_params;
    const Vec2 q = Distort({point.x() / point.z(), point.y() / point.z()});
    Vec2 pixel(k[0] * q.x() + k[2], k[1] * q.y() + k[3]);  // the in-air projection
    const auto miss = [&](const Vec2& at) -> Vec2 {
      const Ray3 ray = Backproject(at);
      const Vec3 there = ray.At((point - ray.origin).norm());
      return (there - point).head<2>();
    };
    for (int i = 0; i < 100; ++i) {
      const double h = 1e-4;
      const Vec2 residual = miss(pixel);
      Mat2 jacobian;
      jacobian.col(0) = (miss(pixel + Vec2(h, 0)) - miss(pixel - Vec2(h, 0))) / (2 * h);
      jacobian.col(1) = (miss(pixel + Vec2(0, h)) - miss(pixel - Vec2(0, h))) / (2 * h);
      const Vec2 step = jacobian.inverse() * residual;
      pixel -= step;
      if (step.squaredNorm() < 1e-18) break;
    }
    return pixel;
  }
};

}  // namespace rsfm::paper

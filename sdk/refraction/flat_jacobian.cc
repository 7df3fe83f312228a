// Derivatives of the flat port's two directions.
#include <cmath>

#include "rsfm/refraction/flat_path.h"

namespace rsfm {
namespace {

// Unit vector along `offset`, perpendicular to the axis to the last digit however short the offset;
// any perpendicular for none.
Vec3 RadialUnit(const Vec3& offset, double r, const Vec3& axis) {
  if (!(r > 0.0)) return axis.unitOrthogonal();
  Vec3 radial = offset / r;
  radial -= axis.dot(radial) * axis;
  const double norm = radial.norm();
  return norm > 0.5 ? Vec3(radial / norm) : Vec3(axis.unitOrthogonal());
}

}  // namespace

// With F(s; r, z) = sum_k l_k tan(theta_k(s)) - r = 0:  ds/dr = 1 / F_s, ds/dz = -tan(theta_water)
// / F_s, and d theta_air = ds / (index_air cos(theta_air)).
FlatPort::Slope FlatPort::MakeSlope(const Path& path) const noexcept {
  Slope slope;
  double sum = 0.0;
  for (int k = 0; k < num_media_; ++k) {
    const double length = k == num_media_ - 1 ? path.z - end_ : length_[k];
    // cos^2 = 1 - s^2 / index_k^2, over that of the lowest medium and without its cancellation.
    const double per_cosine_squared =
        (1.0 + path.u * path.u) / (1.0 + excess_[k] * path.u * path.u);
    const double per_cosine = std::sqrt(per_cosine_squared);
    slope.tangent[k] = ratio_[k] * path.u / std::sqrt(1.0 + excess_[k] * path.u * path.u);
    slope.of[k] = length * per_cosine_squared * per_cosine / index_[k];
    sum += slope.of[k];
  }
  slope.gain = 1.0 / (index_[0] * path.cosine * sum);
  slope.radial = RadialUnit(path.radial, path.r, normal_);
  slope.turn = path.cosine * slope.radial - path.sine * normal_;
  return slope;
}

// Across the plane the direction turns about the axis by dx / r.
Mat3 FlatPort::PointJacobian(const Path& path, const Slope& slope) const noexcept {
  const Vec3 binormal = normal_.cross(slope.radial);
  return (slope.gain * slope.turn) *
             (slope.radial - slope.tangent[num_media_ - 1] * normal_).transpose() +
         (path.sine_over_r * binormal) * binormal.transpose();
}

Projection FlatPort::RefractToAir(const Vec3& point, Vec3* direction,
                                  Mat3* d_direction_d_point) const noexcept {
  Path path;
  if (const Projection status = Solve(point, &path); status != Projection::kOk) return status;
  *direction = Direction(path);
  *d_direction_d_point = PointJacobian(path, MakeSlope(path));
  return Projection::kOk;
}

Projection FlatPort::RefractToAir(const Vec3& point, Vec3* direction,
                                  AirJacobian* jacobian) const noexcept {
  Path path;
  if (const Projection status = Solve(point, &path); status != Projection::kOk) return status;
  const Vec3 air = Direction(path);
  const Slope slope = MakeSlope(path);
  const Mat3 d_point = PointJacobian(path, slope);
  jacobian->d_direction_d_point = d_point;
  auto& d_port = jacobian->d_direction_d_port;
  // Turning port and point together turns the direction: a(Qn, QP) = Q a(n, P). So with dn = omega
  // x n, da = omega x a - (da/dP) (omega x P), and omega = n x dn: dn maps to
  //   (n.a - n a^T) dn - (da/dP) (z - n P^T) dn, for dn across n.
  const Vec3 air_across = air - path.cosine * normal_;
  const Mat3 across = Mat3::Identity() - normal_ * normal_.transpose();
  d_port.leftCols<3>().noalias() = path.cosine * across - normal_ * air_across.transpose() -
                                   path.z * d_point.lazyProduct(across) +
                                   (d_point * normal_) * path.radial.transpose();
  // The water layer gives up what distance and thickness take.
  const int last = num_media_ - 1;
  const double water = slope.tangent[last], invariant = index_[0] * path.sine;
  const auto of_length = [&](int k) { return slope.gain * (water - slope.tangent[k]); };
  // dF/d index_k = -l_k s / (index_k^2 cos^3): at fixed s, a denser medium bends less.
  const auto of_index = [&](int k) { return slope.gain * slope.of[k] * invariant / index_[k]; };
  d_port.col(3) = of_length(0) * slope.turn;
  d_port.col(4) = of_length(1) * slope.turn;
  // sin(theta_air) = s / index_air
  d_port.col(5) = (of_index(0) - path.sine / (path.cosine * index_[0])) * slope.turn;
  d_port.col(6) = of_index(1) * slope.turn;
  d_port.col(7) = of_index(last) * slope.turn;
  if (num_media_ > 3) {
    jacobian->d_direction_d_layers.setZero();
    for (int k = 2; k < last; ++k) {
      jacobian->d_direction_d_layers.col(2 * k - 4) = of_length(k) * slope.turn;
      jacobian->d_direction_d_layers.col(2 * k - 3) = of_index(k) * slope.turn;
    }
  }
  *direction = air;
  return Projection::kOk;
}

// With c = n.v, t = v - c n, s^2 = |t|^2, and for every medium rho = index_air / index, gamma =
// sqrt(1 - rho^2 s^2):
//   origin = (sum_k l_k rho_k / gamma_k) t + end n,   direction = rho_w t + gamma_w n.
Projection FlatPort::RefractToWater(const Vec3& direction, Ray3* ray,
                                    WaterJacobian* jacobian) const noexcept {
  if (const Projection status = RefractToWater(direction, ray); status != Projection::kOk)
    return status;
  const Vec3& n = normal_;
  const double cosine = n.dot(direction);
  const Vec3 t = direction - cosine * n;
  const double sine_squared = t.squaredNorm();
  const int last = num_media_ - 1;
  // rho, rho / gamma and 1 / gamma^3, which is d(rho / gamma) / d rho.
  double rho[kMaxMedia], over[kMaxMedia], cubed[kMaxMedia], across = 0.0, growth = 0.0;
  for (int k = 0; k <= last; ++k) {
    rho[k] = index_[0] / index_[k];
    const double inverse_gamma =
        k == 0 ? 1.0 / cosine : 1.0 / std::sqrt(1.0 - rho[k] * rho[k] * sine_squared);
    over[k] = rho[k] * inverse_gamma;
    cubed[k] = inverse_gamma * inverse_gamma * inverse_gamma;
    if (k == last) break;
    across += length_[k] * over[k];
    growth += length_[k] * rho[k] * rho[k] * rho[k] * cubed[k];  // 2 d across / d s^2
  }
  const double rho_w = rho[last], gamma_w = rho_w / over[last];
  const double bend = rho_w * over[last];  // -2 d gamma_w / d s^2
  const Mat3 flat = Mat3::Identity() - n * n.transpose();
  // ds^2 = 2 t.dv across the direction; dt = (1 - n n^T) dv.
  jacobian->d_origin_d_air = across * flat + growth * t * t.transpose();
  jacobian->d_direction_d_air = rho_w * flat - bend * n * t.transpose();
  // dn across n: dt = -(t.dn) n - c dn, ds^2 = -2 c t.dn.
  const Mat3 of_t = -(n * t.transpose()) - cosine * flat;
  auto& origin = jacobian->d_origin_d_port;
  auto& turned = jacobian->d_direction_d_port;
  origin.leftCols<3>() = across * of_t - (growth * cosine) * t * t.transpose() + end_ * flat;
  turned.leftCols<3>() = rho_w * of_t + gamma_w * flat + (bend * cosine) * n * t.transpose();
  origin.col(3) = over[0] * t + n;
  turned.col(3).setZero();
  origin.col(4) = over[1] * t + n;
  turned.col(4).setZero();
  // Every ratio but that of air grows with index_air and falls with its own index.
  const Vec3 d_direction_d_ratio = t - (rho_w * sine_squared / gamma_w) * n;
  double of_air = 0.0;
  for (int k = 1; k < last; ++k) of_air += length_[k] * cubed[k] / index_[k];
  origin.col(5) = of_air * t;
  turned.col(5) = d_direction_d_ratio / index_[last];
  origin.col(6) = (-length_[1] * cubed[1] * rho[1] / index_[1]) * t;
  turned.col(6).setZero();
  origin.col(7).setZero();
  turned.col(7) = (-rho_w / index_[last]) * d_direction_d_ratio;
  if (num_media_ > 3) {
    jacobian->d_origin_d_layers.setZero();
    jacobian->d_direction_d_layers.setZero();
    for (int k = 2; k < last; ++k) {
      jacobian->d_origin_d_layers.col(2 * k - 4) = over[k] * t + n;
      jacobian->d_origin_d_layers.col(2 * k - 3) =
          (-length_[k] * cubed[k] * rho[k] / index_[k]) * t;
    }
  }
  return Projection::kOk;
}

}  // namespace rsfm

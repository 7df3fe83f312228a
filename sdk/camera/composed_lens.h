// A lens made of a base projection, a distortion in its plane, and a focal length and principal
// point:
//   pixel = focal * Distortion(Base(direction)) + principal point.
// Parameters in COLMAP's order: f (or fx fy), cx, cy, distortion.
#pragma once

#include <array>
#include <cmath>

#include "rsfm/base/linear.h"
#include "rsfm/camera/lens.h"

namespace rsfm {

template <LensModel kModelId, class Base, class Distortion, int kNumFocals>
class ComposedLens {
  static_assert(kNumFocals == 1 || kNumFocals == 2);

 public:
  static constexpr LensModel kModel = kModelId;
  static constexpr int kNumParams = kNumFocals + 2 + Distortion::kNumParams;
  static constexpr int kMaxUnprojectSteps = 30;
  using Params = std::array<double, kNumParams>;
  using Jacobian = LensJacobian<kNumParams>;

  explicit ComposedLens(const Params& params) noexcept : params_(params) {
    max_radius_squared_ = Distortion::MaxRadius(distortion(), Base::kMaxRadius);
    max_radius_squared_ *= max_radius_squared_;
  }

  const Params& params() const noexcept { return params_; }
  // The largest radius in the plane of the base projection at which the distortion still grows.
  double max_radius_squared() const noexcept { return max_radius_squared_; }

  LensStatus Project(const Vec3& direction, Vec2* pixel) const noexcept {
    Vec2 p, q;
    if (!Base::template FromDirection<double>(direction, &p)) return LensStatus::kBehind;
    if (!(p.squaredNorm() <= max_radius_squared_)) return LensStatus::kOutsideDomain;
    if constexpr (Distortion::kIsRadial) {
      Distortion::template Apply<double>(distortion(), p, &q);
    } else {
      Mat2 d_q_d_p;
      Distortion::Apply(distortion(), p, &q, &d_q_d_p, nullptr);
      if (!(d_q_d_p.determinant() > 0.0)) return LensStatus::kOutsideDomain;
    }
    *pixel = Vec2(fx() * q.x() + cx(), fy() * q.y() + cy());
    return LensStatus::kOk;
  }

  LensStatus Project(const Vec3& direction, Vec2* pixel,
                     Mat23* d_pixel_d_direction) const noexcept {
    return ProjectWithJacobian(direction, pixel, d_pixel_d_direction, nullptr);
  }

  LensStatus Project(const Vec3& direction, Vec2* pixel, Jacobian* jacobian) const noexcept {
    return ProjectWithJacobian(direction, pixel, &jacobian->d_pixel_d_direction,
                               &jacobian->d_pixel_d_params);
  }

  // In closed form where the distortion has an inverse; else by Newton with the analytic Jacobian,
  // kept inside the domain, in at most 2 kMaxUnprojectSteps steps.
  LensStatus Unproject(const Vec2& pixel, Vec3* direction) const noexcept {
    const Vec2 q((pixel.x() - cx()) / fx(), (pixel.y() - cy()) / fy());
    Vec2 p = q;
    if constexpr (requires { Distortion::Undistort(distortion(), q, &p); }) {
      if (!Distortion::Undistort(distortion(), q, &p)) return LensStatus::kOutsideDomain;
    } else if constexpr (Distortion::kNumParams > 0) {
      if (!Undistort(q, &p)) return LensStatus::kOutsideDomain;
    }
    if (!(p.squaredNorm() <= max_radius_squared_)) return LensStatus::kOutsideDomain;
    return Base::ToDirection(p, direction) ? LensStatus::kOk : LensStatus::kOutsideDomain;
  }

  template <class T>
  static bool ProjectT(const T* params, const Vec3T<T>& direction, Vec2T<T>* pixel) {
    Vec2T<T> p, q;
    if (!Base::template FromDirection<T>(direction, &p)) return false;
    Distortion::template Apply<T>(params + kNumFocals + 2, p, &q);
    *pixel = Vec2T<T>(params[0] * q.x() + params[kNumFocals],
                      params[kNumFocals - 1] * q.y() + params[kNumFocals + 1]);
    return true;
  }

 private:
  double fx() const { return params_[0]; }
  double fy() const { return params_[kNumFocals - 1]; }
  double cx() const { return params_[kNumFocals]; }
  double cy() const { return params_[kNumFocals + 1]; }
  const double* distortion() const { return params_.data() + kNumFocals + 2; }

  LensStatus ProjectWithJacobian(
      const Vec3& direction, Vec2* pixel, Mat23* d_pixel_d_direction,
      Eigen::Matrix<double, 2, kNumParams>* d_pixel_d_params) const noexcept {
    Vec2 p, q;
    Mat23 d_p_d_direction;
    if (!Base::FromDirection(direction, &p, &d_p_d_direction)) return LensStatus::kBehind;
    if (!(p.squaredNorm() <= max_radius_squared_)) return LensStatus::kOutsideDomain;
    Mat2 d_q_d_p;
    typename Distortion::ParamsJacobian d_q_d_k;
    Distortion::Apply(distortion(), p, &q, &d_q_d_p,
                      d_pixel_d_params != nullptr ? &d_q_d_k : nullptr);
    if constexpr (!Distortion::kIsRadial) {
      if (!(d_q_d_p.determinant() > 0.0)) return LensStatus::kOutsideDomain;
    }
    *pixel = Vec2(fx() * q.x() + cx(), fy() * q.y() + cy());
    d_q_d_p.row(0) *= fx();
    d_q_d_p.row(1) *= fy();
    d_pixel_d_direction->noalias() = d_q_d_p.lazyProduct(d_p_d_direction);
    if (d_pixel_d_params == nullptr) return LensStatus::kOk;
    d_pixel_d_params->template leftCols<kNumFocals + 2>().setZero();
    (*d_pixel_d_params)(0, 0) = q.x();
    (*d_pixel_d_params)(1, kNumFocals - 1) = q.y();
    (*d_pixel_d_params)(0, kNumFocals) = 1.0;
    (*d_pixel_d_params)(1, kNumFocals + 1) = 1.0;
    if constexpr (Distortion::kNumParams > 0) {
      d_pixel_d_params->template rightCols<Distortion::kNumParams>().row(0) = fx() * d_q_d_k.row(0);
      d_pixel_d_params->template rightCols<Distortion::kNumParams>().row(1) = fy() * d_q_d_k.row(1);
    }
    return LensStatus::kOk;
  }

  // From the distorted point, which takes three or four steps for every lens that people use; where
  // that does not settle, once more from the centre, where every distortion is nearly the identity.
  bool Undistort(const Vec2& q, Vec2* result) const noexcept {
    Vec2 start = q;
    if constexpr (requires { Distortion::UndistortStart(distortion(), q); }) {
      start = Distortion::UndistortStart(distortion(), q);
    }
    return Newton(q, start, result) || Newton(q, Vec2::Zero(), result);
  }

  bool Newton(const Vec2& q, const Vec2& start, Vec2* result) const noexcept {
    Vec2 p = start, value;
    Mat2 d_q_d_p;
    const double start_radius_squared = p.squaredNorm();
    if (start_radius_squared > max_radius_squared_)
      p *= 0.99 * std::sqrt(max_radius_squared_ / start_radius_squared);
    for (int step = 0; step < kMaxUnprojectSteps; ++step) {
      Distortion::Apply(distortion(), p, &value, &d_q_d_p, nullptr);
      const double determinant = d_q_d_p.determinant();
      if (!(determinant > 0.0)) return false;
      const Vec2 residual = value - q;
      const double inverse = 1.0 / determinant;
      const Vec2 delta(inverse * (d_q_d_p(1, 1) * residual.x() - d_q_d_p(0, 1) * residual.y()),
                       inverse * (d_q_d_p(0, 0) * residual.y() - d_q_d_p(1, 0) * residual.x()));
      Vec2 next = p - delta;
      // Stay where the distortion is monotone: go half of the way to its edge at most.
      const double radius_squared = next.squaredNorm();
      if (!(radius_squared <= max_radius_squared_)) {
        if (!std::isfinite(radius_squared)) return false;
        const double radius = std::sqrt(p.squaredNorm()), edge = std::sqrt(max_radius_squared_);
        next *= 0.5 * (radius + edge) / std::sqrt(radius_squared);
      }
      const double change = (next - p).squaredNorm();
      p = next;
      if (change <=
          1e-17 * (1e-6 + p.squaredNorm())) {  // the next quadratic step would be below rounding
        *result = p;
        return true;
      }
    }
    return false;
  }

  Params params_;
  double max_radius_squared_;
};

}  // namespace rsfm

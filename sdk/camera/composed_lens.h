// A lens made of a base projection, a distortion in its plane, and a focal length and principal
// point:
//   pixel = focal * Distortion(Base(direction)) + principal point.
// Parameters in COLMAP's order: f (or fx fy), cx, cy, distortion.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <type_traits>
#include <variant>

#include "rsfm/base/linear.h"
#include "rsfm/camera/inverse_series.h"
#include "rsfm/camera/lens.h"
#include "rsfm/camera/lens_block.h"

namespace rsfm {

template <LensModel kModelId, class Base, class Distortion, int kNumFocals>
class ComposedLens {
  static_assert(kNumFocals == 1 || kNumFocals == 2);

 public:
  static constexpr LensModel kModel = kModelId;
  static constexpr int kNumParams = kNumFocals + 2 + Distortion::kNumParams;
  static constexpr int kFastUnprojectSteps = 2;  // enough for the lenses that people use
  static constexpr int kMaxUnprojectSteps = 30;
  using Params = std::array<double, kNumParams>;
  using Jacobian = LensJacobian<kNumParams>;

  explicit ComposedLens(const Params& params) noexcept
      : params_(params), inverse_fx_(1.0 / fx()), inverse_fy_(1.0 / fy()) {
    max_radius_squared_ = Distortion::MaxRadius(distortion(), Base::kMaxRadius);
    max_radius_squared_ *= max_radius_squared_;
    if constexpr (kHasSeries) {
      series_ = Distortion::MakeInverseSeries(distortion());
      safe_radius_squared_ = Distortion::SafeRadius(distortion());
      safe_radius_squared_ *= safe_radius_squared_;
    }
  }

  const Params& params() const noexcept { return params_; }
  // The largest radius in the plane of the base projection at which the distortion still grows.
  double max_radius_squared() const noexcept { return max_radius_squared_; }

  LensStatus Project(const Vec3& direction, Vec2* pixel) const noexcept {
    Vec2 p, q;
    if (!Base::template FromDirection<double>(direction, &p)) return LensStatus::kBehind;
    const double radius_squared = p.squaredNorm();
    if (!(radius_squared <= max_radius_squared_)) return LensStatus::kOutsideDomain;
    if (Distortion::kIsRadial || radius_squared < safe_radius_squared_) {
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

  // The derivatives to the parameters in columns as wide as any model's; those beyond are zero.
  LensStatus Project(const Vec3& direction, Vec2* pixel, Mat23* d_pixel_d_direction,
                     LensParamsJacobian* d_pixel_d_params) const noexcept {
    Eigen::Matrix<double, 2, kNumParams> of_params;
    const LensStatus status =
        ProjectWithJacobian(direction, pixel, d_pixel_d_direction, &of_params);
    if (status != LensStatus::kOk) return status;
    d_pixel_d_params->template leftCols<kNumParams>() = of_params;
    d_pixel_d_params->template rightCols<kMaxLensParams - kNumParams>().setZero();
    return LensStatus::kOk;
  }

  // In closed form where the distortion has an inverse; else by Newton with the analytic Jacobian,
  // kept inside the domain, in at most kFastUnprojectSteps + 2 kMaxUnprojectSteps steps.
  LensStatus Unproject(const Vec2& pixel, Vec3* direction) const noexcept {
    const Vec2 q((pixel.x() - cx()) * inverse_fx_, (pixel.y() - cy()) * inverse_fy_);
    Vec2 p = q;
    if constexpr (requires { Distortion::Undistort(distortion(), q, &p); }) {
      if (!Distortion::Undistort(distortion(), q, &p)) return LensStatus::kOutsideDomain;
    } else if constexpr (Distortion::kNumParams > 0) {
      if (!Undistort(q, &p)) return LensStatus::kOutsideDomain;
    }
    if (!(p.squaredNorm() <= max_radius_squared_)) return LensStatus::kOutsideDomain;
    return Base::ToDirection(p, direction) ? LensStatus::kOk : LensStatus::kOutsideDomain;
  }

  // Whole blocks; entries whose lens status is not kOk keep `settled` zero, and so may entries that
  // only the one-by-one functions can settle.
  void UnprojectBlock(LensBlock* block) const noexcept {
    if constexpr (kHasBlocks) {
      LensBlockParams of_block{.inverse_fx = inverse_fx_,
                               .inverse_fy = inverse_fy_,
                               .cx = cx(),
                               .cy = cy(),
                               .max_radius_squared = max_radius_squared_};
      if constexpr (kHasSeries) {
        Distortion::FillBlockParams(distortion(), series_, &of_block);
        UndistortBlock(of_block, block);
      } else {
        NormalisePixelBlock(of_block, block);
      }
      if constexpr (Base::kIsPerspective) {
        PerspectiveBlock(block);
      } else {
        for (int i = 0; i < kLensBlock; ++i) {
          Vec3 direction = Vec3::UnitZ();
          if (block->settled[i] == 0.0 ||
              !Base::ToDirection(Vec2(block->x[i], block->y[i]), &direction)) {
            block->settled[i] = 0.0;
          }
          block->Set(i, direction);
        }
      }
    } else {
      for (int i = 0; i < kLensBlock; ++i) {
        Vec3 direction = Vec3::UnitZ();
        const LensStatus status = Unproject(Vec2(block->x[i], block->y[i]), &direction);
        block->settled[i] = status == LensStatus::kOk ? 1.0 : 0.0;
        block->Set(i, direction);
      }
    }
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
  static constexpr bool kHasSeries = requires(const double* k) {
    Distortion::MakeInverseSeries(k);
  };
  static constexpr bool kHasBlocks = kHasSeries || Distortion::kNumParams == 0;
  // Of the squared relative change of a Newton step: the next one would be below rounding.
  static constexpr double kSettled = 1e-16;

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

  // From the reverted series, which takes two steps for every lens that people use; where that does
  // not settle, with care from there, and once more from the centre, where every distortion is
  // nearly the identity.
  bool Undistort(const Vec2& q, Vec2* result) const noexcept {
    Vec2 start = q;
    if constexpr (kHasSeries) start = Distortion::UndistortStart(distortion(), series_, q);
    Vec2 p = start, value;
    Mat2 d_q_d_p;
    double change = 0.0, least_determinant = 1.0;
    for (int step = 0; step < kFastUnprojectSteps; ++step) {
      Distortion::Apply(distortion(), p, &value, &d_q_d_p, nullptr);
      const double determinant = d_q_d_p(0, 0) * d_q_d_p(1, 1) - d_q_d_p(0, 1) * d_q_d_p(1, 0);
      const double u = value.x() - q.x(), v = value.y() - q.y(), inverse = 1.0 / determinant;
      const double dx = inverse * (d_q_d_p(1, 1) * u - d_q_d_p(0, 1) * v);
      const double dy = inverse * (d_q_d_p(0, 0) * v - d_q_d_p(1, 0) * u);
      p = Vec2(p.x() - dx, p.y() - dy);
      change = dx * dx + dy * dy;
      least_determinant = std::min(least_determinant, determinant);
    }
    const double radius_squared = p.squaredNorm();
    if (least_determinant > 0.0 && radius_squared <= max_radius_squared_ &&
        change <= kSettled * (1e-6 + radius_squared)) {
      *result = p;
      return true;
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
      if (change <= kSettled * (1e-6 + p.squaredNorm())) {
        *result = p;
        return true;
      }
    }
    return false;
  }

  Params params_;
  double inverse_fx_, inverse_fy_;
  double max_radius_squared_;
  double safe_radius_squared_ = 0.0;  // within it no Jacobian need be looked at
  [[no_unique_address]] std::conditional_t<kHasSeries, InverseSeries, std::monostate> series_;
};

}  // namespace rsfm

// What a lens is: the interface of every in-air camera model, as a concept.
#pragma once

#include <array>
#include <concepts>

#include "rsfm/base/linear.h"
#include "rsfm/camera/lens_block.h"
#include "rsfm/camera/lens_model.h"

namespace rsfm {

// How a lens maps a direction.
enum class LensStatus : std::uint8_t {
  kOk,
  kBehind,         // the model maps no direction this far round
  kOutsideDomain,  // the distortion is not monotone there, or the pixel has no direction
};

// Derivatives of Lens::Project; px per unit of direction and px per unit of parameter.
template <int kNumParams>
struct LensJacobian {
  Mat23 d_pixel_d_direction;
  Eigen::Matrix<double, 2, kNumParams> d_pixel_d_params;
};

// Derivatives to the parameters in columns as wide as any model's; columns a lens has not are zero.
using LensParamsJacobian = Eigen::Matrix<double, 2, kMaxLensParams>;

// Project   direction (any positive length) in the camera frame to pixel; the projection depends on
// the direction alone,
//           so d_pixel_d_direction * direction = 0.
// Unproject pixel to unit direction: its inverse over the domain.
// Both leave their outputs untouched unless they return kOk; the Jacobian may be nullptr.
template <class L>
concept LensMapping = requires(const L lens, const Vec3& direction, const Vec2& pixel,
                               Vec2* pixel_out, Vec3* direction_out, Mat23* d_pixel_d_direction,
                               LensParamsJacobian* d_pixel_d_params, LensBlock* block) {
  { L::kNumParams } -> std::convertible_to<int>;
  { lens.Project(direction, pixel_out) } -> std::same_as<LensStatus>;
  { lens.Project(direction, pixel_out, d_pixel_d_direction) } -> std::same_as<LensStatus>;
  {
    lens.Project(direction, pixel_out, d_pixel_d_direction, d_pixel_d_params)
    } -> std::same_as<LensStatus>;
  { lens.Unproject(pixel, direction_out) } -> std::same_as<LensStatus>;
  lens.UnprojectBlock(block);  // whole blocks of pixels; see lens_block.h
};

// A lens of a model known at compile time.
template <class L>
concept Lens = LensMapping<L> &&
    requires(const L lens, const Vec3& direction, Vec2* pixel_out,
             LensJacobian<L::kNumParams>* jacobian, const double* params) {
  { L::kModel } -> std::convertible_to<LensModel>;
  { lens.Project(direction, pixel_out, jacobian) } -> std::same_as<LensStatus>;
  { lens.params() } -> std::convertible_to<std::array<double, L::kNumParams>>;
  // The same projection over any scalar, so that automatic differentiation can check the Jacobians.
  { L::template ProjectT<double>(params, direction, pixel_out) } -> std::same_as<bool>;
};

}  // namespace rsfm

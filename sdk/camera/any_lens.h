// Any lens of the list, chosen at run time: one indirect call for a direction or a pixel, or one
// for a block. It is a lens like the others (LensMapping), of as many parameters as any has.
//
// Plain bytes, copied as such; nothing is allocated. The models themselves are compiled in
// lens_ops_*.cc, and whoever includes this header is spared them.
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <span>

#include "rsfm/camera/lens.h"

namespace rsfm {

namespace lens_ops {

// What a model does, over the bytes of one lens of it.
struct Ops {
  LensModel model;
  void (*make)(const double* params, void* lens);
  double (*max_radius_squared)(const void* lens);
  LensStatus (*project)(const void* lens, const Vec3& direction, Vec2* pixel);
  LensStatus (*project_with_direction)(const void* lens, const Vec3& direction, Vec2* pixel,
                                       Mat23* d_pixel_d_direction);
  LensStatus (*project_with_params)(const void* lens, const Vec3& direction, Vec2* pixel,
                                    Mat23* d_pixel_d_direction,
                                    LensParamsJacobian* d_pixel_d_params);
  LensStatus (*unproject)(const void* lens, const Vec2& pixel, Vec3* direction);
  void (*unproject_block)(const void* lens, LensBlock* block);
};

// The models of one source file; nullptr for those of others.
const Ops* FindPinholeOps(LensModel model) noexcept;
const Ops* FindRadialOps(LensModel model) noexcept;
const Ops* FindFisheyeOps(LensModel model) noexcept;
const Ops* FindPrismOps(LensModel model) noexcept;

}  // namespace lens_ops

class AnyLens {
 public:
  static constexpr int kNumParams = kMaxLensParams;
  static constexpr std::size_t kMaxBytes = 320;

  // None when there is no such model, or its number of parameters is another.
  static std::optional<AnyLens> Create(LensModel model, std::span<const double> params) noexcept;

  LensModel model() const noexcept { return ops_->model; }
  // Zero where the parameters make a lens that maps nothing.
  double max_radius_squared() const noexcept { return ops_->max_radius_squared(bytes_.data()); }

  LensStatus Project(const Vec3& direction, Vec2* pixel) const noexcept {
    return ops_->project(bytes_.data(), direction, pixel);
  }
  LensStatus Project(const Vec3& direction, Vec2* pixel,
                     Mat23* d_pixel_d_direction) const noexcept {
    return ops_->project_with_direction(bytes_.data(), direction, pixel, d_pixel_d_direction);
  }
  LensStatus Project(const Vec3& direction, Vec2* pixel, Mat23* d_pixel_d_direction,
                     LensParamsJacobian* d_pixel_d_params) const noexcept {
    return ops_->project_with_params(bytes_.data(), direction, pixel, d_pixel_d_direction,
                                     d_pixel_d_params);
  }
  LensStatus Unproject(const Vec2& pixel, Vec3* direction) const noexcept {
    return ops_->unproject(bytes_.data(), pixel, direction);
  }
  void UnprojectBlock(LensBlock* block) const noexcept {
    ops_->unproject_block(bytes_.data(), block);
  }

 private:
  AnyLens() = default;

  const lens_ops::Ops* ops_ = nullptr;
  alignas(16) std::array<std::byte, kMaxBytes> bytes_{};
};
static_assert(LensMapping<AnyLens>);

}  // namespace rsfm

// The table of functions of one lens model, for AnyLens. Included by lens_ops_*.cc only.
#pragma once

#include <algorithm>
#include <new>
#include <type_traits>

#include "rsfm/camera/any_lens.h"
#include "rsfm/camera/lens_list.h"

namespace rsfm::lens_ops {

template <Lens L>
const L& As(const void* lens) {
  return *static_cast<const L*>(lens);
}

template <Lens L>
inline constexpr Ops kOps = {
    .model = L::kModel,
    .make =
        [](const double* params, void* lens) {
          static_assert(sizeof(L) <= AnyLens::kMaxBytes && alignof(L) <= 16 &&
                        std::is_trivially_copyable_v<L>);
          typename L::Params values;
          std::copy_n(params, L::kNumParams, values.begin());
          new (lens) L(values);
        },
    .max_radius_squared = [](const void* lens) { return As<L>(lens).max_radius_squared(); },
    .project = [](const void* lens, const Vec3& direction,
                  Vec2* pixel) { return As<L>(lens).Project(direction, pixel); },
    .project_with_direction =
        [](const void* lens, const Vec3& direction, Vec2* pixel, Mat23* d_pixel_d_direction) {
          return As<L>(lens).Project(direction, pixel, d_pixel_d_direction);
        },
    .project_with_params =
        [](const void* lens, const Vec3& direction, Vec2* pixel, Mat23* d_pixel_d_direction,
           LensParamsJacobian* d_pixel_d_params) {
          return As<L>(lens).Project(direction, pixel, d_pixel_d_direction, d_pixel_d_params);
        },
    .unproject = [](const void* lens, const Vec2& pixel,
                    Vec3* direction) { return As<L>(lens).Unproject(pixel, direction); },
    .unproject_block = [](const void* lens,
                          LensBlock* block) { As<L>(lens).UnprojectBlock(block); },
};

template <Lens... Ls>
const Ops* Find(LensModel model, LensTypeList<Ls...>) {
  const Ops* found = nullptr;
  (void)((Ls::kModel == model ? (found = &kOps<Ls>, true) : false) || ...);
  return found;
}

}  // namespace rsfm::lens_ops

#include "rsfm/camera/any_lens.h"

namespace rsfm {

std::optional<AnyLens> AnyLens::Create(LensModel model, std::span<const double> params) noexcept {
  if (params.empty() || static_cast<int>(params.size()) != NumLensParams(model))
    return std::nullopt;
  AnyLens lens;
  for (const auto find : {lens_ops::FindPinholeOps, lens_ops::FindRadialOps,
                          lens_ops::FindFisheyeOps, lens_ops::FindPrismOps}) {
    if (lens.ops_ == nullptr) lens.ops_ = find(model);
  }
  if (lens.ops_ == nullptr) return std::nullopt;
  lens.ops_->make(params.data(), lens.bytes_.data());
  return lens;
}

}  // namespace rsfm

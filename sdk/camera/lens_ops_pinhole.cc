// Lenses without distortion, or with one that has a closed inverse.
#include "rsfm/camera/lens_ops.h"

namespace rsfm::lens_ops {

const Ops* FindPinholeOps(LensModel model) noexcept { return Find(model, PinholeLenses{}); }

}  // namespace rsfm::lens_ops

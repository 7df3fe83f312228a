// Equidistant lenses with radial distortion.
#include "rsfm/camera/lens_ops.h"

namespace rsfm::lens_ops {

const Ops* FindFisheyeOps(LensModel model) noexcept { return Find(model, FisheyeLenses{}); }

}  // namespace rsfm::lens_ops

// Perspective lenses with polynomial or rational distortion.
#include "rsfm/camera/lens_ops.h"

namespace rsfm::lens_ops {

const Ops* FindRadialOps(LensModel model) noexcept { return Find(model, RadialLenses{}); }

}  // namespace rsfm::lens_ops

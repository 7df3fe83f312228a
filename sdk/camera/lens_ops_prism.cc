// Equidistant lenses with tangential and thin-prism distortion.
#include "rsfm/camera/lens_ops.h"

namespace rsfm::lens_ops {

const Ops* FindPrismOps(LensModel model) noexcept { return Find(model, PrismLenses{}); }

}  // namespace rsfm::lens_ops

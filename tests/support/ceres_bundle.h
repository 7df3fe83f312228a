// AdjustBundle by Ceres on the same residuals: what the desk's own solver is checked and measured
// against.
#pragma once

#include "tools/offline/bundle.h"

namespace rsfm {

// As AdjustBundle, of valid problems.
Expected<BundleReport> AdjustBundleByCeres(const BundleOptions& options, BundleProblem* problem);

}  // namespace rsfm

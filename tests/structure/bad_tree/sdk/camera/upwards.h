// Not part of the project: what the include check must refuse.
#include <opencv2/core.hpp>

#include "rsfm/base/error.h"
#include "rsfm/mapping/keyframe.h"

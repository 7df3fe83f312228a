#include "rsfm/base/error.h"

namespace rsfm {

const char* ToString(Errc code) noexcept {
  switch (code) {
    case Errc::kInvalidArgument:
      return "invalid argument";
    case Errc::kOutOfCapacity:
      return "out of capacity";
    case Errc::kNotFound:
      return "not found";
    case Errc::kNotEnoughData:
      return "not enough data";
    case Errc::kNotEnoughInliers:
      return "not enough inliers";
    case Errc::kDegenerate:
      return "degenerate geometry";
    case Errc::kNotConverged:
      return "not converged";
    case Errc::kOutOfOrder:
      return "out of order in time";
    case Errc::kUnsupported:
      return "unsupported";
    case Errc::kIo:
      return "input/output error";
    case Errc::kCorrupt:
      return "corrupt data";
  }
  return "unknown error";
}

}  // namespace rsfm

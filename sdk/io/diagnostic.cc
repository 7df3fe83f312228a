#include "rsfm/io/diagnostic.h"

#include <cerrno>
#include <cstring>

namespace rsfm {

std::string ToString(const Diagnostic& diagnostic) {
  std::string text = diagnostic.file;
  if (diagnostic.line > 0) text += ":" + std::to_string(diagnostic.line);
  if (!text.empty()) text += ": ";
  if (!diagnostic.field.empty()) text += diagnostic.field + ": ";
  text += diagnostic.problem;
  if (!diagnostic.fix.empty()) text += "; " + diagnostic.fix;
  return text;
}

int ExitCode(const Diagnostic& diagnostic) {
  switch (diagnostic.code) {
    case Errc::kInvalidArgument:
    case Errc::kNotFound:
    case Errc::kOutOfOrder:
    case Errc::kUnsupported:
    case Errc::kCorrupt:
      return 2;
    case Errc::kOutOfCapacity:
    case Errc::kNotEnoughData:
    case Errc::kNotEnoughInliers:
    case Errc::kDegenerate:
    case Errc::kNotConverged:
    case Errc::kIo:
      break;
  }
  return 1;
}

Diagnostic FromErrno(int error, std::string_view file, std::string_view doing) {
  Diagnostic result;
  result.file = file;
  result.problem = "cannot " + std::string(doing) + ": " + std::strerror(error);
  switch (error) {
    case ENOENT:
      result.code = Errc::kNotFound;
      result.fix = "give a path that exists";
      break;
    case ENOTDIR:
    case EISDIR:
    case ENAMETOOLONG:
    case ELOOP:
      result.code = Errc::kInvalidArgument;
      result.fix = "give another path";
      break;
    case EACCES:
    case EPERM:
    case EROFS:
      result.code = Errc::kInvalidArgument;
      result.fix = "change its permissions or give another path";
      break;
    case ENOSPC:
    case EDQUOT:
      result.code = Errc::kIo;
      result.fix = "free space or give a path on another disk";
      break;
    default:
      result.code = Errc::kIo;
      break;
  }
  return result;
}

}  // namespace rsfm

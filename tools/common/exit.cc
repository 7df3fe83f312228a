#include "tools/common/exit.h"

#include <cerrno>
#include <cstdio>

namespace rsfm {

int Report(const Diagnostic& diagnostic) {
  std::fprintf(stderr, "error: %s\n", ToString(diagnostic).c_str());
  return ExitCode(diagnostic);
}

void Warn(const Diagnostic& diagnostic) {
  std::fprintf(stderr, "warning: %s\n", ToString(diagnostic).c_str());
}

int ReportInterrupted() {
  std::fprintf(stderr, "error: interrupted; the output was not written\n");
  return kExitFailed;
}

int FinishStdout() {
  errno = 0;
  if (std::fflush(stdout) == 0 && std::ferror(stdout) == 0) return kExitDone;
  return Report(FromErrno(errno != 0 ? errno : EIO, "standard output", "write"));
}

}  // namespace rsfm

// How a program of this project ends.
#pragma once

#include "rsfm/io/diagnostic.h"

namespace rsfm {

inline constexpr int kExitDone = 0;
inline constexpr int kExitFailed = 1;  // the work failed
inline constexpr int kExitWrongRequest =
    2;  // the request is wrong: the message says what to change

// Prints "error: FILE: FIELD: problem; fix" on stderr and returns the exit code.
int Report(const Diagnostic& diagnostic);
// The same as a warning: the work goes on.
void Warn(const Diagnostic& diagnostic);

// Says that the user stopped the work, and that nothing half-written is left. kExitFailed.
int ReportInterrupted();

// Flushes standard output; kExitFailed with a message when it could not be written.
int FinishStdout();

}  // namespace rsfm

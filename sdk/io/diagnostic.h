// What is wrong with a file, a request or an output, said so that a person can repair it.
#pragma once

#include <string>
#include <string_view>
#include <tl/expected.hpp>

#include "rsfm/base/error.h"

namespace rsfm {

struct [[nodiscard]] Diagnostic {
  Errc code = Errc::kInvalidArgument;
  std::string file;     // path as the user gave it; empty: no file is to blame
  std::string field;    // "port.normal", "column depth_m", "--align"; empty: the whole file
  std::string problem;  // what is wrong, with the offending value
  std::string fix;      // what to change; empty: nothing the user can do
  int line = 0;         // 1-based; 0: no line is to blame
};

template <class T>
using IoExpected = tl::expected<T, Diagnostic>;
using IoStatus = IoExpected<void>;

inline tl::unexpected<Diagnostic> Fail(Diagnostic diagnostic) {
  return tl::unexpected<Diagnostic>(std::move(diagnostic));
}

// "FILE:LINE: FIELD: problem; fix", without the parts that are empty.
std::string ToString(const Diagnostic& diagnostic);

// 2 where the request (an argument, an input file) is wrong, 1 where the work itself failed (the
// disk is full, an estimate did not succeed).
int ExitCode(const Diagnostic& diagnostic);

// The failure of a system call on `file`, from errno: ENOENT and its like blame the request, the
// rest the work. `doing` completes "cannot ...": "open for reading".
Diagnostic FromErrno(int error, std::string_view file, std::string_view doing);

}  // namespace rsfm

// Lines of numbers from standard input, one result line each on standard output: what `project` and
// `backproject` share.
#pragma once

#include <functional>
#include <optional>
#include <span>
#include <string>

#include "rsfm/refraction/any_camera.h"

namespace rsfm {

// Reads the camera of a rig or camera file and reports what is wrong with it; the exit code then, 0
// when *camera is set.
int LoadCamera(const std::string& path, std::optional<AnyCamera>* camera);

// Calls `convert` with the numbers of each line and prints what it appends to the text. A line that
// is not exactly `num_fields` numbers stops the work: exit code 2, its number on standard error,
// the lines before it printed. `wanted` says what a line must be.
int ConvertLines(std::size_t num_fields, const char* wanted,
                 const std::function<void(std::span<const double>, std::string*)>& convert);

// Appends the numbers with 17 significant digits, blanks between them, or that many "nan" and the
// reason.
void AppendNumbers(std::span<const double> values, std::string* text);
void AppendFailure(std::size_t num_values, Projection reason, std::string* text);

}  // namespace rsfm

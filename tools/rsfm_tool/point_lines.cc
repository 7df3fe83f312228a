#include "tools/rsfm_tool/point_lines.h"

#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdio>
#include <vector>

#include "rsfm/io/rig.h"
#include "rsfm/io/text.h"
#include "tools/common/exit.h"
#include "tools/common/progress.h"

namespace rsfm {
namespace {

constexpr std::size_t kReadBytes = std::size_t{1} << 16;
constexpr std::size_t kMaxFields = 3;

bool WriteText(std::string* text) {
  const bool is_written = std::fwrite(text->data(), 1, text->size(), stdout) == text->size();
  text->clear();
  return is_written;
}

}  // namespace

int LoadCamera(const std::string& path, std::optional<AnyCamera>* camera) {
  std::vector<Diagnostic> problems;
  const auto rig = ReadRig(path, &problems);
  for (const Diagnostic& problem : problems) Report(problem);
  if (!rig) return ExitCode(rig.error());
  auto created = AnyCamera::Create(rig->camera);
  if (!created) {
    return Report({created.error().code, path, created.error().where, "is not possible",
                   "correct it in the camera file"});
  }
  *camera = *created;
  return kExitDone;
}

void AppendNumbers(std::span<const double> values, std::string* text) {
  char number[32];
  for (std::size_t i = 0; i < values.size(); ++i) {
    const int size = std::snprintf(number, sizeof number, i > 0 ? " %.17g" : "%.17g", values[i]);
    text->append(number, static_cast<std::size_t>(size));
  }
  text->push_back('\n');
}

void AppendFailure(std::size_t num_values, Projection reason, std::string* text) {
  for (std::size_t i = 0; i < num_values; ++i) text->append("nan ");
  text->append(ToString(reason)).push_back('\n');
}

int ConvertLines(std::size_t num_fields, const char* wanted,
                 const std::function<void(std::span<const double>, std::string*)>& convert) {
  std::string input, output;
  std::array<double, kMaxFields> values{};
  std::vector<std::string_view> fields;
  int line_number = 0;
  const auto convert_line = [&](std::string_view line) {
    ++line_number;
    SplitBlanks(line, &fields);
    bool is_good = fields.size() == num_fields;
    for (std::size_t i = 0; is_good && i < num_fields; ++i) {
      const auto value = ParseNumber(fields[i]);
      is_good = value.has_value();
      if (is_good) values[i] = *value;
    }
    if (is_good) convert(std::span(values.data(), num_fields), &output);
    return is_good;
  };
  const auto malformed = [&](std::string_view line) {
    WriteText(&output);
    FinishStdout();
    return Report({Errc::kInvalidArgument, "standard input", "", "is malformed: " + Quoted(line),
                   wanted, line_number});
  };
  bool at_end = false;
  while (!at_end) {
    const std::size_t old_size = input.size();
    input.resize(old_size + kReadBytes);
    const ssize_t n = ::read(STDIN_FILENO, input.data() + old_size, kReadBytes);
    if (n < 0 && errno != EINTR) return Report(FromErrno(errno, "standard input", "read"));
    if (IsInterrupted()) return ReportInterrupted();
    input.resize(old_size + static_cast<std::size_t>(n < 0 ? 0 : n));
    at_end = n == 0;
    // Whole lines only, but for the last of the input.
    const std::size_t last_end = input.rfind('\n');
    const std::size_t size = at_end                          ? input.size()
                             : last_end == std::string::npos ? 0
                                                             : last_end + 1;
    std::string_view rest(input.data(), size), line;
    while (NextLine(&rest, &line)) {
      if (!convert_line(line)) return malformed(line);
    }
    input.erase(0, size);
    // Whoever feeds us line by line gets each answer at once.
    errno = 0;
    if (!WriteText(&output) || std::fflush(stdout) != 0) {
      return Report(FromErrno(errno != 0 ? errno : EIO, "standard output", "write"));
    }
  }
  return FinishStdout();
}

}  // namespace rsfm

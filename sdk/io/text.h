// Small parts of text files: numbers in full precision, fields of a line.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace rsfm {

// The shortest text that reads back as the same double.
std::string FormatNumber(double value);
// "[1, 2.5, 3]"
std::string FormatList(const double* values, std::size_t size);

// The whole of `text` as a number; NaN and infinities are numbers here. No locale.
std::optional<double> ParseNumber(std::string_view text);
std::optional<std::int64_t> ParseInteger(std::string_view text);
// "2019-05-17 08:03:21.250" in UTC, with none to six digits of the second's fraction, as
// microseconds since the epoch.
std::optional<std::int64_t> ParseDateTime(std::string_view text);

std::string_view Trim(std::string_view text);
// Fields between separators, trimmed; empty ones are kept.
std::vector<std::string_view> SplitAt(std::string_view text, char separator);
// Fields between runs of blanks.
void SplitBlanks(std::string_view text, std::vector<std::string_view>* fields);

// The next line of *rest without its line end ("\n" or "\r\n"); false at the end.
bool NextLine(std::string_view* rest, std::string_view* line);

// "'name'" for messages, shortened, with control characters replaced.
std::string Quoted(std::string_view text);

// The candidate nearest to `word` by edit distance, if it is near enough to be a slip; else empty.
std::string_view NearestWord(std::string_view word,
                             const std::vector<std::string_view>& candidates);

}  // namespace rsfm

#include "rsfm/io/pgm.h"

#include <algorithm>
#include <cstddef>

namespace rsfm {
namespace {

bool IsBlank(char c) { return c == ' ' || (c >= '\t' && c <= '\r'); }

// A number after blanks and comments, of at most six digits; -1: there is none.
long TakeNumber(std::string_view* rest) {
  std::size_t at = 0;
  while (at < rest->size() && (IsBlank((*rest)[at]) || (*rest)[at] == '#'))
    at = (*rest)[at] == '#' ? std::min(rest->find('\n', at), rest->size()) : at + 1;
  const std::size_t start = at;
  long number = 0;
  for (; at < rest->size() && (*rest)[at] >= '0' && (*rest)[at] <= '9'; ++at) {
    if (at - start == 6) return -1;
    number = 10 * number + ((*rest)[at] - '0');
  }
  rest->remove_prefix(at);
  return at > start && start > 0 ? number : -1;
}

}  // namespace

std::string_view PgmPixels(std::string_view bytes, int width, int height) {
  if (width < 1 || height < 1 || !bytes.starts_with("P5")) return {};
  std::string_view rest = bytes.substr(2);
  if (TakeNumber(&rest) != width || TakeNumber(&rest) != height || TakeNumber(&rest) != 255)
    return {};
  // One blank, then pixels.
  const std::size_t size = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  if (rest.empty() || !IsBlank(rest[0]) || rest.size() - 1 < size) return {};
  return rest.substr(1, size);
}

}  // namespace rsfm

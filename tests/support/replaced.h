// A text with one place changed, to make bad files from good ones.
#pragma once

#include <gtest/gtest.h>

#include <string>

namespace rsfm {

// `text` with the first `from` replaced by `to`; it must be there.
inline std::string Replaced(std::string text, const std::string& from, const std::string& to) {
  const std::size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return at == std::string::npos ? text : text.replace(at, from.size(), to);
}

}  // namespace rsfm

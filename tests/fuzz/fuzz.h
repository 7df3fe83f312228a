// What the fuzz targets share: a target is LLVMFuzzerTestOneInput, linked to libFuzzer (clang,
// preset `fuzz`) or to replay_main.cc, which runs the corpus once in every build.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <string_view>

#include "tests/support/temporary_folder.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);

namespace rsfm {

inline std::string_view AsText(const std::uint8_t* data, std::size_t size) {
  return {reinterpret_cast<const char*>(data), size};
}

// A folder that lives as long as the process.
inline const std::filesystem::path& FuzzFolder() {
  static const TemporaryFolder folder;
  return folder.path();
}

inline void WriteFuzzFile(const std::filesystem::path& path, std::string_view content) {
  std::FILE* file = std::fopen(path.c_str(), "wb");
  if (file == nullptr) std::abort();
  // An empty input has no address.
  if (!content.empty() && std::fwrite(content.data(), 1, content.size(), file) != content.size())
    std::abort();
  std::fclose(file);
}

// A property that must hold for every input.
inline void Require(bool holds) {
  if (!holds) std::abort();
}

}  // namespace rsfm

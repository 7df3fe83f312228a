// Outputs that are whole or absent: written aside under a hidden name in the same folder, forced to
// the disk, then renamed into place. What is not committed is removed by the destructor; what a
// killed process left behind is removed by the next writer of the same output.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

#include "rsfm/io/diagnostic.h"

namespace rsfm {

class AtomicFile {
 public:
  // Creates the parent folder where it is missing. A folder in the file's place is an error.
  static IoExpected<AtomicFile> Create(const std::filesystem::path& path);
  AtomicFile(AtomicFile&& other) noexcept;
  AtomicFile& operator=(AtomicFile&&) = delete;
  ~AtomicFile();

  // Buffered. The first failure is kept: every later call and Commit() report it too.
  IoStatus Write(std::string_view bytes);
  // After success the file is in place, replacing any earlier one, and on the disk.
  IoStatus Commit();

  const std::filesystem::path& path() const { return path_; }

 private:
  AtomicFile(std::filesystem::path path, std::filesystem::path aside, int fd);
  IoStatus Flush();

  std::filesystem::path path_;
  std::filesystem::path aside_;
  std::string buffer_;
  IoStatus status_;
  int fd_ = -1;
};

IoStatus WriteFileAtomically(const std::filesystem::path& path, std::string_view content);

enum class Existing {
  kRefuse,   // a folder that exists and is not empty is an error
  kReplace,  // it is replaced if it is a mission or model (holds rig.yaml), else an error
};

class AtomicFolder {
 public:
  static IoExpected<AtomicFolder> Create(const std::filesystem::path& path,
                                         Existing existing = Existing::kRefuse);
  AtomicFolder(AtomicFolder&& other) noexcept;
  AtomicFolder& operator=(AtomicFolder&&) = delete;
  ~AtomicFolder();

  // Write here until Commit().
  const std::filesystem::path& aside() const { return aside_; }
  const std::filesystem::path& path() const { return path_; }

  // Forces every file below to the disk, then renames. An earlier folder is exchanged in one step
  // and removed afterwards. An error of a file that was not written whole is the caller's to
  // notice: do not commit then.
  IoStatus Commit();

 private:
  AtomicFolder(std::filesystem::path path, std::filesystem::path aside);

  std::filesystem::path path_;
  std::filesystem::path aside_;
};

// Whole file into memory. `max_bytes` guards against being pointed at a disk image: 4 GiB, or what
// 32 bits can have.
inline constexpr std::size_t kMaxFileBytes = sizeof(std::size_t) > 4
                                                 ? static_cast<std::size_t>(std::uint64_t{1} << 32)
                                                 : SIZE_MAX / 4;
IoExpected<std::string> ReadWholeFile(const std::filesystem::path& path,
                                      std::size_t max_bytes = kMaxFileBytes);

}  // namespace rsfm

#include "rsfm/io/atomic_output.h"

#include <fcntl.h>
#include <signal.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <utility>

namespace rsfm {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kBufferBytes = std::size_t{1} << 18;
constexpr std::string_view kAsideMark = ".partial-";

// "out/", "out/." and "out" name the same output.
fs::path Normalised(const fs::path& path) {
  fs::path result = fs::absolute(path).lexically_normal();
  if (!result.has_filename()) result = result.parent_path();
  return result;
}

fs::path AsidePath(const fs::path& path) {
  return path.parent_path() /
         ("." + path.filename().string() + std::string(kAsideMark) + std::to_string(::getpid()));
}

// Removes what processes that no longer run left behind for this output.
void RemoveStale(const fs::path& path) {
  const std::string prefix = "." + path.filename().string() + std::string(kAsideMark);
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator(path.parent_path(), error)) {
    const std::string name = entry.path().filename().string();
    if (name.compare(0, prefix.size(), prefix) != 0) continue;
    const long pid = std::strtol(name.c_str() + prefix.size(), nullptr, 10);
    const bool is_running =
        pid > 0 && pid != ::getpid() && (::kill(static_cast<pid_t>(pid), 0) == 0 || errno == EPERM);
    std::error_code ignored;
    if (!is_running) fs::remove_all(entry.path(), ignored);
  }
}

IoStatus PrepareParent(const fs::path& path) {
  std::error_code error;
  fs::create_directories(path.parent_path(), error);
  if (error)
    return Fail(FromErrno(error.value(), path.parent_path().string(), "create the folder"));
  RemoveStale(path);
  return {};
}

IoStatus SyncPath(const fs::path& path, int flags) {
  const int fd = ::open(path.c_str(), flags | O_CLOEXEC);
  if (fd < 0) return Fail(FromErrno(errno, path.string(), "open to force it to the disk"));
  const int result = ::fsync(fd);
  const int error = errno;
  ::close(fd);
  // Some file systems cannot sync a folder: their rename is what it is.
  if (result != 0 && error != EINVAL && error != EROFS) {
    return Fail(FromErrno(error, path.string(), "force it to the disk"));
  }
  return {};
}

IoStatus SyncTree(const fs::path& root) {
  std::error_code error;
  for (fs::recursive_directory_iterator it(root, error), end; !error && it != end;
       it.increment(error)) {
    if (it->is_symlink()) continue;
    const bool is_folder = it->is_directory();
    if (!is_folder && !it->is_regular_file()) continue;
    if (auto status = SyncPath(it->path(), is_folder ? O_RDONLY | O_DIRECTORY : O_RDONLY); !status)
      return status;
  }
  if (error) return Fail(FromErrno(error.value(), root.string(), "list the folder"));
  return SyncPath(root, O_RDONLY | O_DIRECTORY);
}

}  // namespace

AtomicFile::AtomicFile(fs::path path, fs::path aside, int fd)
    : path_(std::move(path)), aside_(std::move(aside)), fd_(fd) {
  buffer_.reserve(kBufferBytes);
}

AtomicFile::AtomicFile(AtomicFile&& other) noexcept
    : path_(std::move(other.path_)),
      aside_(std::move(other.aside_)),
      buffer_(std::move(other.buffer_)),
      status_(std::move(other.status_)),
      fd_(std::exchange(other.fd_, -1)) {}

AtomicFile::~AtomicFile() {
  if (fd_ < 0) return;
  ::close(fd_);
  ::unlink(aside_.c_str());
}

IoExpected<AtomicFile> AtomicFile::Create(const fs::path& requested) {
  const fs::path path = Normalised(requested);
  if (fs::is_directory(path)) return Fail(FromErrno(EISDIR, requested.string(), "write the file"));
  if (auto status = PrepareParent(path); !status) return Fail(status.error());
  fs::path aside = AsidePath(path);
  const int fd = ::open(aside.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  if (fd < 0) return Fail(FromErrno(errno, requested.string(), "create the file"));
  return AtomicFile(path, std::move(aside), fd);
}

IoStatus AtomicFile::Flush() {
  std::size_t done = 0;
  while (done < buffer_.size()) {
    const ssize_t n = ::write(fd_, buffer_.data() + done, buffer_.size() - done);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) {
      status_ = Fail(FromErrno(errno, path_.string(), "write"));
      return status_;
    }
    done += static_cast<std::size_t>(n);
  }
  buffer_.clear();
  return {};
}

IoStatus AtomicFile::Write(std::string_view bytes) {
  if (!status_) return status_;
  buffer_.append(bytes);
  return buffer_.size() < kBufferBytes ? IoStatus() : Flush();
}

IoStatus AtomicFile::Commit() {
  if (!status_) return status_;
  if (auto status = Flush(); !status) return status;
  if (::fsync(fd_) != 0) {
    status_ = Fail(FromErrno(errno, path_.string(), "force it to the disk"));
    return status_;
  }
  // From here on the destructor has nothing to remove.
  if (::close(std::exchange(fd_, -1)) != 0 || ::rename(aside_.c_str(), path_.c_str()) != 0) {
    status_ = Fail(FromErrno(errno, path_.string(), "put it in place"));
    ::unlink(aside_.c_str());
    return status_;
  }
  return SyncPath(path_.parent_path(), O_RDONLY | O_DIRECTORY);
}

IoStatus WriteFileAtomically(const fs::path& path, std::string_view content) {
  auto file = AtomicFile::Create(path);
  if (!file) return Fail(file.error());
  if (auto status = file->Write(content); !status) return status;
  return file->Commit();
}

AtomicFolder::AtomicFolder(fs::path path, fs::path aside)
    : path_(std::move(path)), aside_(std::move(aside)) {}

AtomicFolder::AtomicFolder(AtomicFolder&& other) noexcept
    : path_(std::move(other.path_)), aside_(std::exchange(other.aside_, fs::path())) {}

AtomicFolder::~AtomicFolder() {
  std::error_code ignored;
  if (!aside_.empty()) fs::remove_all(aside_, ignored);
}

IoExpected<AtomicFolder> AtomicFolder::Create(const fs::path& requested, Existing existing) {
  const fs::path path = Normalised(requested);
  std::error_code error;
  if (fs::exists(path, error) && !fs::is_directory(path, error)) {
    return Fail({Errc::kInvalidArgument, requested.string(), "", "is a file, not a folder",
                 "give another output folder"});
  }
  if (fs::is_directory(path, error) && !fs::is_empty(path, error)) {
    if (existing == Existing::kRefuse) {
      return Fail({Errc::kInvalidArgument, requested.string(), "",
                   "the output folder exists and is not empty",
                   "give another one, remove it, or pass --overwrite"});
    }
    if (!fs::exists(path / "rig.yaml", error)) {
      return Fail({Errc::kInvalidArgument, requested.string(), "",
                   "the output folder is neither a mission nor a model, so it is not overwritten",
                   "give another one or remove it yourself"});
    }
  }
  if (auto status = PrepareParent(path); !status) return Fail(status.error());
  fs::path aside = AsidePath(path);
  if (!fs::create_directory(aside, error) || error) {
    return Fail(FromErrno(error ? error.value() : EEXIST, requested.string(), "create the folder"));
  }
  return AtomicFolder(path, std::move(aside));
}

IoStatus AtomicFolder::Commit() {
  if (auto status = SyncTree(aside_); !status) return status;
  // An empty folder in place is replaced by rename itself; a full one is exchanged first.
  bool is_exchanged = false;
  if (::rename(aside_.c_str(), path_.c_str()) != 0) {
    if (errno != ENOTEMPTY && errno != EEXIST) {
      return Fail(FromErrno(errno, path_.string(), "put it in place"));
    }
    if (::renameat2(AT_FDCWD, aside_.c_str(), AT_FDCWD, path_.c_str(), RENAME_EXCHANGE) != 0) {
      return Fail(FromErrno(errno, path_.string(), "put it in place"));
    }
    is_exchanged = true;
  }
  std::error_code ignored;
  if (is_exchanged) fs::remove_all(aside_, ignored);
  aside_.clear();
  return SyncPath(path_.parent_path(), O_RDONLY | O_DIRECTORY);
}

IoExpected<std::string> ReadWholeFile(const fs::path& path, std::size_t max_bytes) {
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (fd < 0) return Fail(FromErrno(errno, path.string(), "open for reading"));
  std::string content;
  std::size_t done = 0;
  int error = 0;
  while (true) {
    content.resize(done + kBufferBytes);
    const ssize_t n = ::read(fd, content.data() + done, kBufferBytes);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) error = errno;
    if (n <= 0) break;
    done += static_cast<std::size_t>(n);
    if (done > max_bytes) error = EFBIG;
    if (error != 0) break;
    if (content.capacity() < done + kBufferBytes) content.reserve(2 * done + kBufferBytes);
  }
  ::close(fd);
  if (error != 0) return Fail(FromErrno(error, path.string(), "read"));
  content.resize(done);
  return content;
}

}  // namespace rsfm

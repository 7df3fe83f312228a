#include "tools/onboard/recorder.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>

#include "rsfm/io/mission.h"
#include "tools/onboard/system.h"

namespace rsfm {
namespace {

constexpr std::int64_t kCheckPeriodUs = 1'000'000;  // of the free space

int WriteAll(int fd, const void* data, std::size_t size) {
  const char* bytes = static_cast<const char*>(data);
  while (size > 0) {
    const ssize_t n = ::write(fd, bytes, size);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return errno;
    bytes += n;
    size -= static_cast<std::size_t>(n);
  }
  return 0;
}

int WriteImage(const std::filesystem::path& path, std::span<const std::uint8_t> data) {
  const std::string aside = path.string() + ".part";
  const int fd = ::open(aside.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  if (fd < 0) return errno;
  int error = WriteAll(fd, data.data(), data.size());
  if (::close(fd) != 0 && error == 0) error = errno;
  if (error == 0 && ::rename(aside.c_str(), path.c_str()) != 0) error = errno;
  if (error != 0) ::unlink(aside.c_str());
  return error;
}

}  // namespace

RecorderDisk RealDisk() { return {WriteImage, FreeDiskBytes}; }

IoExpected<std::unique_ptr<Recorder>> Recorder::Create(const std::filesystem::path& mission,
                                                       const OnboardOptions& options, int width,
                                                       int height, RecorderDisk disk) {
  std::error_code error;
  const std::filesystem::path images = mission / kImagesFolder, table = mission / kImagesFile;
  std::filesystem::create_directories(images, error);
  if (error) return Fail(FromErrno(error.value(), images.string(), "create the folder"));
  auto encoder = JpegEncoder::Create(width, height);
  if (!encoder) {
    return Fail({encoder.error().code, "", encoder.error().where, "stops libjpeg-turbo", ""});
  }
  const int fd = ::open(table.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  if (fd < 0) return Fail(FromErrno(errno, table.string(), "create the table"));
  constexpr std::string_view kHeader = "image,utime\n";
  if (const int problem = WriteAll(fd, kHeader.data(), kHeader.size()); problem != 0) {
    ::close(fd);
    return Fail(FromErrno(problem, table.string(), "write"));
  }
  ::fdatasync(fd);
  auto recorder = std::unique_ptr<Recorder>(
      new Recorder(mission, std::move(*encoder), width, std::move(disk), fd));
  if (options.record_lossless) recorder->PreparePgm(width, height);
  recorder->SetQuality(options.jpeg_quality);
  recorder->SetLimits(options.image_quota_mb, options.min_disk_free_mb);
  return recorder;
}

Recorder::Recorder(std::filesystem::path mission, JpegEncoder encoder, int width, RecorderDisk disk,
                   int table_fd)
    : mission_(std::move(mission)),
      images_(mission_ / kImagesFolder),
      encoder_(std::move(encoder)),
      width_(width),
      disk_(std::move(disk)),
      table_fd_(table_fd) {
  constexpr std::size_t kRows = 1 << 16;  // 1600 of them: more than come between two flushes
  rows_.reserve(kRows);
}

Recorder::~Recorder() {
  Flush();
  ::close(table_fd_);
}

void Recorder::SetLimits(std::int64_t quota_mb, std::int64_t min_free_mb) {
  quota_bytes_ = quota_mb * 1'000'000;
  min_free_bytes_ = min_free_mb * 1'000'000;
}

void Recorder::PreparePgm(int width, int height) {
  char header[48];
  const int bytes = std::snprintf(header, sizeof header, "P5\n%d %d\n255\n", width, height);
  pgm_header_bytes_ = static_cast<std::size_t>(bytes);
  pgm_.assign(header, header + bytes);
  pgm_.resize(pgm_.size() + static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
}

std::span<const std::uint8_t> Recorder::Encode(const Frame& frame) {
  if (!pgm_.empty()) {
    std::copy_n(frame.grey.data(), pgm_.size() - pgm_header_bytes_,
                pgm_.data() + pgm_header_bytes_);
    return pgm_;
  }
  const auto data = encoder_.Encode(frame.grey.data(), width_, quality_);
  return data ? *data : std::span<const std::uint8_t>();
}

void Recorder::Name(std::int64_t number, bool lossless, std::string* name) {
  char text[48];
  std::snprintf(text, sizeof text, "%04lld/%06lld.%s",
                static_cast<long long>(number / kImagesPerSegment), static_cast<long long>(number),
                lossless ? "pgm" : "jpg");
  name->assign(text);
}

bool Recorder::Refuse(const char* problem, std::int64_t now_us) {
  problem_ = problem;
  paused_until_us_ = now_us + kPauseUs;
  return false;
}

bool Recorder::MayRecord(std::int64_t now_us) {
  const std::int64_t quota = quota_bytes_;
  if (quota > 0 && bytes_ >= quota) {
    problem_ = "images are not recorded: the mission's quota is used up";
    return false;
  }
  if (now_us < paused_until_us_) return false;
  if (now_us - last_check_us_ >= kCheckPeriodUs) {
    last_check_us_ = now_us;
    const std::int64_t free = disk_.free_bytes(mission_);
    if (free >= 0 && free < min_free_bytes_)
      return Refuse("images are not recorded: too little room on the disk", now_us);
  }
  return true;
}

bool Recorder::MakeSegment(const std::string& image) {
  const std::size_t slash = image.find('/');
  if (slash == std::string::npos || image.compare(0, slash, segment_) == 0) return true;
  std::error_code error;
  std::filesystem::create_directories(images_ / image.substr(0, slash), error);
  if (error) return false;
  segment_ = image.substr(0, slash);
  return true;
}

bool Recorder::Record(const Frame& frame, std::int64_t now_us) {
  if (!MayRecord(now_us)) {
    ++num_failed_;
    return false;
  }
  const std::span<const std::uint8_t> data = Encode(frame);
  if (data.empty() || !MakeSegment(frame.image) || disk_.write(images_ / frame.image, data) != 0) {
    ++num_failed_;
    return Refuse("images are not recorded: the disk refuses them", now_us);
  }
  problem_ = nullptr;
  ++num_recorded_;
  bytes_ += static_cast<std::int64_t>(data.size());
  rows_.append(frame.image).append(",").append(std::to_string(frame.utime)).append("\n");
  return true;
}

void Recorder::FlushIfDue(std::int64_t now_us) {
  if (rows_.empty() || now_us - last_flush_us_ < kFlushPeriodUs) return;
  last_flush_us_ = now_us;
  Flush();
}

void Recorder::Flush() {
  if (rows_.empty()) return;
  ::syncfs(table_fd_);
  // One call for whole rows: who is killed leaves no half of one. On a full disk they wait.
  const off_t end = ::lseek(table_fd_, 0, SEEK_END);
  if (WriteAll(table_fd_, rows_.data(), rows_.size()) != 0) {
    static_cast<void>(::ftruncate(table_fd_, end) + 0);
    ::lseek(table_fd_, end, SEEK_SET);
    if (rows_.size() < rows_.capacity() / 2) return;
  }
  rows_.clear();
  ::fdatasync(table_fd_);
}

}  // namespace rsfm

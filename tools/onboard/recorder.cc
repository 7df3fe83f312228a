#include "tools/onboard/recorder.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <climits>
#include <cstdio>
#include <iterator>

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

int WriteImage(const char* path, std::span<const std::uint8_t> data) {
  char aside[PATH_MAX];
  if (std::snprintf(aside, sizeof aside, "%s.part", path) >= PATH_MAX) return ENAMETOOLONG;
  const int fd = ::open(aside, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  if (fd < 0) return errno;
  int error = WriteAll(fd, data.data(), data.size());
  if (::close(fd) != 0 && error == 0) error = errno;
  if (error == 0 && ::rename(aside, path) != 0) error = errno;
  if (error != 0) ::unlink(aside);
  return error;
}

bool MakeFolder(const char* path) { return ::mkdir(path, 0777) == 0 || errno == EEXIST; }

}  // namespace

RecorderDisk RealDisk() {
  return {WriteImage, [](int fd) { return ::syncfs(fd) == 0 ? 0 : errno; },
          [](int fd) { return ::fdatasync(fd) == 0 || errno == EINVAL ? 0 : errno; },
          FreeDiskBytes};
}

IoExpected<std::unique_ptr<Recorder>> Recorder::Create(const std::filesystem::path& mission,
                                                       const OnboardOptions& options, int width,
                                                       int height, RecorderDisk disk) {
  auto encoder = JpegEncoder::Create(width, height);
  if (!encoder) {
    return Fail({encoder.error().code, "", encoder.error().where, "stops libjpeg-turbo", ""});
  }
  auto recorder =
      std::unique_ptr<Recorder>(new Recorder(mission, std::move(*encoder), width, std::move(disk)));
  if (options.record_lossless) recorder->PreparePgm(width, height);
  recorder->SetQuality(options.jpeg_quality);
  recorder->SetLimits(options.image_quota_mb, options.min_disk_free_mb);
  return recorder;
}

Recorder::Recorder(const std::filesystem::path& mission, JpegEncoder encoder, int width,
                   RecorderDisk disk)
    : mission_(mission),
      images_((mission / kImagesFolder).string()),
      encoder_(std::move(encoder)),
      width_(width),
      disk_(std::move(disk)) {
  constexpr std::size_t kRows = 1 << 16;  // 1600 of them: more than come between two flushes
  rows_.reserve(kRows);
  path_.reserve(images_.size() + FramePool::kMaxName + 1);
  segment_.reserve(FramePool::kMaxName);
}

Recorder::~Recorder() {
  Flush();
  if (table_fd_ >= 0) ::close(table_fd_);
}

// The folder of images, and the table with its head.
bool Recorder::Open() {
  if (table_fd_ >= 0) return true;
  if (!MakeFolder(images_.c_str())) return false;
  const int fd =
      ::open((mission_ / kImagesFile).c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  if (fd < 0) return false;
  constexpr std::string_view kHeader = "image,utime\n";
  if (WriteAll(fd, kHeader.data(), kHeader.size()) != 0 || disk_.sync(fd) != 0) {
    ::close(fd);
    return false;
  }
  table_fd_ = fd;
  return true;
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

bool Recorder::MakeSegment(std::string_view image) {
  const std::string_view segment = image.substr(0, image.find('/'));
  if (segment.size() == image.size() || segment == segment_) return true;
  path_.assign(images_).append("/").append(segment);
  if (!MakeFolder(path_.c_str())) return false;
  segment_ = segment;
  return true;
}

bool Recorder::Write(const Frame& frame) {
  const std::span<const std::uint8_t> data = Encode(frame);
  if (data.empty() || !Open() || !MakeSegment(frame.image)) return false;
  path_.assign(images_).append("/").append(frame.image);
  if (disk_.write(path_.c_str(), data) != 0) return false;
  bytes_ += static_cast<std::int64_t>(data.size());
  return true;
}

void Recorder::AddRow(const Frame& frame) {
  char utime[24];
  const auto [end, error] = std::to_chars(std::begin(utime), std::end(utime), frame.utime);
  rows_.append(frame.image).append(",").append(utime, end).append("\n");
  ++num_rows_;
}

bool Recorder::Record(const Frame& frame, std::int64_t now_us) {
  last_record_us_ = now_us;
  if (!MayRecord(now_us)) {
    ++num_failed_;
    return false;
  }
  if (!Write(frame)) {
    ++num_failed_;
    return Refuse("images are not recorded: the disk refuses them", now_us);
  }
  problem_ = nullptr;
  ++num_recorded_;
  AddRow(frame);
  return true;
}

void Recorder::FlushIfDue(std::int64_t now_us) {
  if (rows_.empty() || now_us - last_flush_us_ < kFlushPeriodUs) return;
  last_flush_us_ = now_us;
  Flush();
}

// What is not in the table is not in the mission.
void Recorder::LoseRows(const char* problem) {
  num_recorded_ -= num_rows_;
  num_failed_ += num_rows_;
  num_rows_ = 0;
  rows_.clear();
  Refuse(problem, last_record_us_);
}

void Recorder::Flush() {
  if (rows_.empty()) return;
  if (disk_.sync_all(table_fd_) != 0) {
    LoseRows("images are not recorded: the disk fails while it is made to keep them");
    return;
  }
  // One call for whole rows: who is killed leaves no half of one. On a full disk they wait.
  const off_t end = ::lseek(table_fd_, 0, SEEK_END);
  if (WriteAll(table_fd_, rows_.data(), rows_.size()) != 0) {
    static_cast<void>(::ftruncate(table_fd_, end) + 0);
    ::lseek(table_fd_, end, SEEK_SET);
    if (rows_.size() >= rows_.capacity() / 2)
      LoseRows("images are not recorded: images.csv cannot be written");
    return;
  }
  rows_.clear();
  num_rows_ = 0;
  if (disk_.sync(table_fd_) != 0)
    Refuse("images are not recorded: the disk fails while it is made to keep images.csv",
           last_record_us_);
}

}  // namespace rsfm

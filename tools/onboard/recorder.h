// Images of a mission as JPEG or PGM: images/0000/000000.jpg and so on, a thousand to a segment,
// with images.csv growing behind them. What images.csv lists is whole and on the disk.
#pragma once

#include <atomic>
#include <filesystem>
#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "rsfm/io/diagnostic.h"
#include "rsfm/io/onboard_options.h"
#include "rsfm_drivers/jpeg/jpeg.h"
#include "tools/onboard/frame_pool.h"

namespace rsfm {

// Stands between the recorder and the disk, so that tests can fill it. 0 or the errno.
struct RecorderDisk {
  // The file is whole or absent.
  std::function<int(const char* path, std::span<const std::uint8_t>)> write;
  // All that was written to the file system that `fd` lies on, or the file's own data.
  std::function<int(int fd)> sync_all, sync;
  std::function<std::int64_t(const std::filesystem::path&)> free_bytes;  // negative: not known
};
RecorderDisk RealDisk();

class Recorder {
 public:
  static constexpr int kImagesPerSegment = 1000;
  static constexpr std::int64_t kFlushPeriodUs = 500'000;
  // After the disk refused an image, or had too little room, it is asked again this much later.
  static constexpr std::int64_t kPauseUs = 10'000'000;

  // Takes all its memory; folder and table are made with the first image.
  static IoExpected<std::unique_ptr<Recorder>> Create(const std::filesystem::path& mission,
                                                      const OnboardOptions& options, int width,
                                                      int height, RecorderDisk disk = RealDisk());
  ~Recorder();

  // "0000/000000.jpg" of the image with that number; ".pgm" where nothing may be lost.
  static void Name(std::int64_t number, bool lossless, std::string* name);

  // Encodes and writes one image under its name. False, and counted, where that is not done;
  // problem() then says why. `now_us` is monotonic.
  bool Record(const Frame& frame, std::int64_t now_us);
  // Writes the table's new rows after forcing their images to the disk, when that is due. Images
  // that the disk took and then could not keep are not listed, and count as failed.
  void FlushIfDue(std::int64_t now_us);
  void Flush();

  // From any thread.
  void SetQuality(int quality) { quality_ = quality; }
  void SetLimits(std::int64_t quota_mb, std::int64_t min_free_mb);
  std::int64_t num_recorded() const { return num_recorded_; }
  std::int64_t num_failed() const { return num_failed_; }
  std::int64_t bytes() const { return bytes_; }
  // Why images are not recorded now, or null. Points to static storage.
  const char* problem() const { return problem_; }

 private:
  Recorder(const std::filesystem::path& mission, JpegEncoder encoder, int width, RecorderDisk disk);
  void PreparePgm(int width, int height);
  // The file's bytes, until the next call; empty: it cannot be encoded.
  std::span<const std::uint8_t> Encode(const Frame& frame);
  bool MayRecord(std::int64_t now_us);
  bool Open();
  bool MakeSegment(std::string_view image);
  bool Write(const Frame& frame);
  void AddRow(const Frame& frame);
  void LoseRows(const char* problem);
  bool Refuse(const char* problem, std::int64_t now_us);

  std::filesystem::path mission_;
  std::string images_;  // folder
  std::string path_;    // of the image in work
  JpegEncoder encoder_;
  std::vector<std::uint8_t> pgm_;  // its header, and room for the pixels; empty: JPEG
  std::size_t pgm_header_bytes_ = 0;
  int width_;
  RecorderDisk disk_;
  int table_fd_ = -1;
  std::string rows_;  // of images.csv, not yet in it
  std::int64_t num_rows_ = 0;
  std::string segment_;  // that exists
  std::int64_t last_flush_us_ = 0, last_record_us_ = 0;
  std::int64_t last_check_us_ = INT64_MIN / 2;  // of the free space
  std::int64_t paused_until_us_ = INT64_MIN;
  std::atomic<int> quality_ = 90;
  std::atomic<std::int64_t> quota_bytes_ = 0, min_free_bytes_ = 0;
  std::atomic<std::int64_t> num_recorded_ = 0, num_failed_ = 0, bytes_ = 0;
  std::atomic<const char*> problem_ = nullptr;
};

}  // namespace rsfm

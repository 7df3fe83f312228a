// Images to the disk: names, table, quota, a disk that is full or refuses.
#include "tools/onboard/recorder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <sys/mount.h>
#include <unistd.h>

#include <cerrno>
#include <fstream>

#include "rsfm/base/rng.h"
#include "rsfm/io/tables.h"
#include "tests/support/malloc_trap.h"
#include "tests/support/temporary_folder.h"

namespace rsfm {
namespace {

using ::testing::HasSubstr;

constexpr int kWidth = 64, kHeight = 48;

std::vector<char> BytesOf(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  return std::vector<char>((std::istreambuf_iterator<char>(file)), {});
}

class RecorderTest : public ::testing::Test {
 protected:
  RecorderTest() {
    disk_ = RealDisk();
    disk_.free_bytes = [this](const std::filesystem::path&) { return free_bytes_; };
    frame_.grey.assign(kWidth * kHeight, 90);
  }
  std::unique_ptr<Recorder> Make() {
    auto recorder = Recorder::Create(folder_.path(), options_, kWidth, kHeight, disk_);
    EXPECT_TRUE(recorder) << ToString(recorder.error());
    return std::move(*recorder);
  }
  // Image `number`, 33 ms after the one before.
  bool Record(Recorder* recorder, std::int64_t number) {
    Recorder::Name(number, options_.record_lossless, &frame_.image);
    frame_.utime = 1'000'000 + 33'000 * number;
    now_us_ += 33'000;
    return recorder->Record(frame_, now_us_);
  }
  std::vector<ImageTime> Table() {
    const auto images = ReadImageTimes(folder_.path() / "images.csv");
    EXPECT_TRUE(images) << ToString(images.error());
    return images.value_or(std::vector<ImageTime>());
  }

  TemporaryFolder folder_;
  OnboardOptions options_;
  RecorderDisk disk_;
  std::int64_t free_bytes_ = std::int64_t{1} << 40;
  std::int64_t now_us_ = 0;
  Frame frame_;
};

// Every grey as it was: what a replay maps is what the mapper saw.
TEST_F(RecorderTest, LosslessImagesAreThoseOfTheCamera) {
  options_.record_lossless = true;
  Rng rng(3);
  for (auto& grey : frame_.grey) grey = static_cast<std::uint8_t>(rng.Uniform(0.0, 256.0));
  const auto recorder = Make();
  ASSERT_TRUE(Record(recorder.get(), 4));
  const std::vector<char> bytes = BytesOf(folder_.path() / "images/0000/000004.pgm");
  const std::string header = "P5\n64 48\n255\n";
  ASSERT_EQ(bytes.size(), header.size() + frame_.grey.size());
  EXPECT_EQ(std::string(bytes.data(), header.size()), header);
  EXPECT_TRUE(std::equal(frame_.grey.begin(), frame_.grey.end(), bytes.begin() + header.size(),
                         [](std::uint8_t a, char b) { return a == static_cast<std::uint8_t>(b); }));
  EXPECT_EQ(recorder->bytes(), static_cast<std::int64_t>(bytes.size()));
}

TEST_F(RecorderTest, NamesAreSegmentsOfAThousand) {
  std::string name;
  Recorder::Name(7, false, &name);
  EXPECT_EQ(name, "0000/000007.jpg");
  Recorder::Name(12'345, false, &name);
  EXPECT_EQ(name, "0012/012345.jpg");
}

TEST_F(RecorderTest, ImagesAndTableAgree) {
  auto recorder = Make();
  for (const std::int64_t number : {0, 1, 999, 1000, 2001})
    EXPECT_TRUE(Record(recorder.get(), number));
  recorder->Flush();
  const auto table = Table();
  ASSERT_EQ(table.size(), 5u);
  auto decoder = JpegDecoder::Create();
  for (const ImageTime& image : table) {
    const std::vector<char> bytes = BytesOf(folder_.path() / "images" / image.image);
    std::vector<std::uint8_t> grey(kWidth * kHeight);
    ASSERT_TRUE(decoder->Decode(
        std::span(reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()), kWidth,
        kHeight, grey.data()))
        << image.image;
    EXPECT_NEAR(grey[100], 90, 2);
  }
  EXPECT_EQ(table[3].image, "0001/001000.jpg");
  EXPECT_EQ(table[3].utime, 1'000'000 + 33'000'000);
  EXPECT_EQ(recorder->num_recorded(), 5);
  EXPECT_EQ(recorder->num_failed(), 0);
}

TEST_F(RecorderTest, TheTableGrowsEveryHalfSecond) {
  auto recorder = Make();
  recorder->FlushIfDue(now_us_);
  Record(recorder.get(), 0);
  recorder->Flush();
  EXPECT_EQ(Table().size(), 1u);
  for (std::int64_t number = 1; number < 40; ++number) {
    Record(recorder.get(), number);
    recorder->FlushIfDue(now_us_);
    const auto listed = static_cast<std::int64_t>(Table().size());
    EXPECT_LE(number + 1 - listed, 16) << number;  // 16 x 33 ms
  }
}

TEST_F(RecorderTest, TheQuotaEndsRecordingAndSaysSo) {
  options_.image_quota_mb = 1;
  disk_.write = [](const char*, std::span<const std::uint8_t>) { return 0; };
  auto recorder = Make();
  std::int64_t number = 0;
  while (Record(recorder.get(), number)) {
    ASSERT_LT(++number, 10'000);
  }
  EXPECT_GE(recorder->bytes(), 1'000'000);
  EXPECT_LT(recorder->bytes(), 1'010'000);
  EXPECT_THAT(recorder->problem(), HasSubstr("quota"));
  EXPECT_FALSE(Record(recorder.get(), number + 1));
  EXPECT_EQ(recorder->num_failed(), 2);
  recorder->SetLimits(2, 0);  // SIGHUP with a larger one
  EXPECT_TRUE(Record(recorder.get(), number + 2));
  EXPECT_EQ(recorder->problem(), nullptr);
}

TEST_F(RecorderTest, AFullDiskPausesRecordingAndRoomResumesIt) {
  auto recorder = Make();
  EXPECT_TRUE(Record(recorder.get(), 0));
  free_bytes_ = 100'000'000;  // below min_disk_free_mb
  now_us_ += 2'000'000;
  EXPECT_FALSE(Record(recorder.get(), 1));
  EXPECT_THAT(recorder->problem(), HasSubstr("too little room"));
  free_bytes_ = std::int64_t{1} << 40;
  EXPECT_FALSE(Record(recorder.get(), 2));  // not asked again yet
  now_us_ += Recorder::kPauseUs;
  EXPECT_TRUE(Record(recorder.get(), 3));
  EXPECT_EQ(recorder->problem(), nullptr);
  EXPECT_EQ(recorder->num_failed(), 2);
  recorder->Flush();
  ASSERT_EQ(Table().size(), 2u);
  EXPECT_EQ(Table()[1].image, "0000/000003.jpg");
}

TEST_F(RecorderTest, ARefusedWriteIsNotListedAndIsTriedAgain) {
  int error = 0;
  const RecorderDisk real = RealDisk();
  disk_.write = [&](const char* path, std::span<const std::uint8_t> data) {
    return error != 0 ? error : real.write(path, data);
  };
  auto recorder = Make();
  for (const int refused : {EIO, ENOSPC, EROFS}) {
    error = refused;
    EXPECT_FALSE(Record(recorder.get(), 10 * refused));
    EXPECT_THAT(recorder->problem(), HasSubstr("disk refuses"));
    error = 0;
    now_us_ += Recorder::kPauseUs;
    EXPECT_TRUE(Record(recorder.get(), 10 * refused + 1));
  }
  recorder->Flush();
  EXPECT_EQ(recorder->num_failed(), 3);
  EXPECT_EQ(recorder->num_recorded(), 3);
}

// A file system of 128 kB that really is full, in the middle of an image: what is listed is whole,
// and nothing else is left. One image less, and the next is recorded.
TEST_F(RecorderTest, AFullFileSystemKeepsWholeImagesOnly) {
  const auto mission = folder_.path() / "mission";
  std::filesystem::create_directories(mission);
  if (::geteuid() != 0 || ::mount("tmpfs", mission.c_str(), "tmpfs", 0, "size=128k") != 0)
    GTEST_SKIP() << "a file system may not be mounted here";
  {
    options_.min_disk_free_mb = 0;
    Rng rng(3);
    for (std::uint8_t& grey : frame_.grey) grey = static_cast<std::uint8_t>(rng.Next() & 255);
    auto recorder = Recorder::Create(mission, options_, kWidth, kHeight, RealDisk());
    ASSERT_TRUE(recorder) << ToString(recorder.error());
    std::int64_t number = 0;
    while (Record(recorder->get(), number)) ASSERT_LT(++number, 100);
    EXPECT_GT(number, 5);
    EXPECT_THAT((*recorder)->problem(), HasSubstr("disk refuses"));
    EXPECT_EQ((*recorder)->num_recorded(), number);
    (*recorder)->Flush();  // the table may find no room: its rows wait

    std::filesystem::remove(mission / "images" / "0000" / "000000.jpg");
    now_us_ += Recorder::kPauseUs;
    EXPECT_TRUE(Record(recorder->get(), number + 1));
    EXPECT_EQ((*recorder)->problem(), nullptr);
    (*recorder)->Flush();

    const auto table = ReadImageTimes(mission / "images.csv");
    ASSERT_TRUE(table) << ToString(table.error());
    ASSERT_EQ(static_cast<std::int64_t>(table->size()), number + 1);
    auto decoder = JpegDecoder::Create();
    std::vector<std::uint8_t> grey(kWidth * kHeight);
    for (std::size_t i = 1; i < table->size(); ++i) {
      const std::vector<char> bytes = BytesOf(mission / "images" / (*table)[i].image);
      EXPECT_TRUE(decoder->Decode(
          std::span(reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()), kWidth,
          kHeight, grey.data()))
          << (*table)[i].image;
    }
    std::int64_t num_files = 0;
    for (const auto& file : std::filesystem::directory_iterator(mission / "images" / "0000")) {
      EXPECT_EQ(file.path().extension(), ".jpg");
      ++num_files;
    }
    EXPECT_EQ(num_files, number);  // one was removed
  }
  ::umount2(mission.c_str(), MNT_DETACH);
}

// A folder that cannot be made costs the images and is tried again.
TEST_F(RecorderTest, AFolderThatCannotBeIsRefusedUntilItCan) {
  auto recorder = Make();
  EXPECT_FALSE(std::filesystem::exists(folder_.path() / "images"));  // nothing before an image
  EXPECT_FALSE(std::filesystem::exists(folder_.path() / "images.csv"));
  std::filesystem::create_directories(folder_.path() / "images.csv");  // in the table's way
  EXPECT_FALSE(Record(recorder.get(), 0));
  EXPECT_THAT(recorder->problem(), HasSubstr("disk refuses"));
  std::filesystem::remove(folder_.path() / "images.csv");
  now_us_ += Recorder::kPauseUs;
  EXPECT_TRUE(Record(recorder.get(), 1));
  recorder->Flush();
  ASSERT_EQ(Table().size(), 1u);
  EXPECT_EQ(Table()[0].image, "0000/000001.jpg");
}

// A disk that took the images and fails when it must keep them: they are not in the table, and are
// counted.
TEST_F(RecorderTest, ImagesThatTheDiskCouldNotKeepAreNotListed) {
  int all_error = 0, table_error = 0;
  disk_.sync_all = [&](int) { return all_error; };
  disk_.sync = [&](int) { return table_error; };
  auto recorder = Make();
  EXPECT_TRUE(Record(recorder.get(), 0));
  recorder->Flush();
  EXPECT_TRUE(Record(recorder.get(), 1));
  EXPECT_TRUE(Record(recorder.get(), 2));
  all_error = EIO;
  recorder->Flush();
  EXPECT_EQ(Table().size(), 1u);
  EXPECT_EQ(recorder->num_recorded(), 1);
  EXPECT_EQ(recorder->num_failed(), 2);
  EXPECT_THAT(recorder->problem(), HasSubstr("made to keep them"));
  all_error = 0;
  table_error = EIO;
  now_us_ += Recorder::kPauseUs;
  EXPECT_TRUE(Record(recorder.get(), 3));
  recorder->Flush();
  EXPECT_THAT(recorder->problem(), HasSubstr("images.csv"));
}

// Folder and table once, then nothing but libjpeg-turbo asks for memory.
TEST_F(RecorderTest, RecordingDoesNotAllocate) {
  options_.record_lossless = true;
  auto recorder = Make();
  ASSERT_TRUE(Record(recorder.get(), 0));
  recorder->Flush();
  std::size_t calls = 0;
  for (std::int64_t number = 998; number < 1003; ++number) {  // over the end of a segment
    Recorder::Name(number, true, &frame_.image);
    frame_.utime += 600'000;
    now_us_ += 600'000;
    const MallocTrap trap;
    recorder->Record(frame_, now_us_);
    recorder->FlushIfDue(now_us_);
    calls += trap.count();
  }
  EXPECT_EQ(calls, 0u);
  EXPECT_EQ(Table().size(), 6u);
}

}  // namespace
}  // namespace rsfm

// A mission: the folder that a vehicle brings home.
//   rig.yaml     the rig it was recorded with
//   events.lcm   LCM event log: every navigation message consumed, everything published
//   images.csv   image,utime of every image that was offered to the mapper
//   images/      the images, or a link to where they lie; may be absent
//   ground_truth/  of simulated missions: trajectory.tum (world_from_camera), a COLMAP model,
//   mesh.ply
#pragma once

#include <array>
#include <filesystem>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "rsfm/io/diagnostic.h"
#include "rsfm/io/event_log.h"
#include "rsfm/io/messages.h"
#include "rsfm/io/model.h"
#include "rsfm/io/rig.h"
#include "rsfm/io/tables.h"
#include "rsfm/navigation/nav_sample.h"

namespace rsfm {

inline constexpr std::string_view kRigFile = "rig.yaml";
inline constexpr std::string_view kEventsFile = "events.lcm";
inline constexpr std::string_view kImagesFile = "images.csv";
inline constexpr std::string_view kImagesFolder = "images";
inline constexpr std::string_view kGroundTruthFolder = "ground_truth";

// Writes into a folder that exists; give AtomicFolder::aside() where a mission must appear whole,
// the final folder itself where it must survive a loss of power.
class MissionWriter {
 public:
  static IoExpected<MissionWriter> Create(const std::filesystem::path& folder, const Rig& rig,
                                          const EventLogWriterOptions& options = {});

  // Logs a message under a channel. `utime` is the time of receipt or publication; replays of files
  // use the measurement's time, so that the same input gives the same bytes.
  template <class Message>
  IoStatus Log(std::string_view channel, Utime utime, const Message& message) {
    if (!Encode(message, &encoded_)) {
      return Fail({Errc::kInvalidArgument, folder_.string(), std::string(channel),
                   "the message's arrays do not have the length it states", ""});
    }
    return log_.Append(channel, utime, encoded_.data(), encoded_.size());
  }
  IoStatus LogRaw(std::string_view channel, Utime utime, std::span<const std::uint8_t> data) {
    return log_.Append(channel, utime, data.data(), data.size());
  }

  IoStatus WriteRigFile(const Rig& rig);  // again, when the world's frame has been decided
  IoStatus WriteImageTimes(const std::vector<ImageTime>& images);
  // Makes `images` a link to a folder elsewhere.
  IoStatus LinkImages(const std::filesystem::path& images_folder);

  EventLogWriter& log() { return log_; }
  IoStatus Close() { return log_.Close(); }

 private:
  MissionWriter(std::filesystem::path folder, EventLogWriter log);

  std::filesystem::path folder_;
  EventLogWriter log_;
  std::vector<std::uint8_t> encoded_;
};

struct MissionLandmark {
  Vec3 xyz = Vec3::Zero();
  std::array<std::uint8_t, 3> rgb = {128, 128, 128};
};

struct Mission {
  std::filesystem::path folder;
  Rig rig;
  std::vector<ImageTime> images;      // in the order of images.csv; empty where there is none
  std::vector<NavSample> nav;         // sorted by utime, lever arms removed
  std::vector<pose_t> poses;          // in the order of the log
  std::vector<keyframe_t> keyframes;  // sorted by id; the last word on each, loops included
  std::map<std::int32_t, MissionLandmark> landmarks;  // the last word on each
  std::vector<status_t> statuses;
  std::vector<water_t>
      waters;  // in the order of the log; none from a mapper that says nothing of it
  EventLogStatistics log;
  std::optional<Geodetic> origin;     // of NED: the rig's, or else the first fix's
  std::int64_t num_malformed = 0;     // events on our channels that are not what the channel says
  std::int64_t num_nav_rejected = 0;  // not finite, or without a usable field

  // The index of water that the mapper had for an image of that time: the rig's where it says none.
  double IndexWaterAt(Utime utime) const;
  // Where the images are, or empty.
  std::filesystem::path ImagesFolder() const;
};

struct MissionReadOptions {
  bool keep_descriptors =
      true;  // false: keyframes come without theirs, in a fraction of the memory
};

IoExpected<Mission> ReadMission(const std::filesystem::path& folder,
                                const MissionReadOptions& options = {});

// True for a folder with an events.lcm or, failing that, a rig.yaml beside an images folder.
bool IsMissionFolder(const std::filesystem::path& folder);

// The on-board result as a model: its keyframes, their features, the landmarks they saw. World and
// camera as the mission's rig has them.
Model ModelFromMission(const Mission& mission);

}  // namespace rsfm

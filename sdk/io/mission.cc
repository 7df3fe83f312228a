#include "rsfm/io/mission.h"

#include <algorithm>
#include <unordered_map>

#include "rsfm/io/atomic_output.h"
#include "rsfm/io/csv.h"
#include "rsfm/io/nav_messages.h"

namespace rsfm {
namespace {

namespace fs = std::filesystem;

// False where a message's quaternion w x y z and translation are none.
bool ToPose(const double (&q)[4], const double (&t)[3], Rigid3* pose) {
  const Quat rotation(q[0], q[1], q[2], q[3]);
  const Vec3 translation(t[0], t[1], t[2]);
  if (!(std::abs(rotation.norm() - 1.0) < 1e-6) || !translation.allFinite()) return false;
  *pose = Rigid3(rotation, translation);
  return true;
}
bool PoseOf(const keyframe_t& keyframe, Rigid3* camera_from_world) {
  return ToPose(keyframe.camera_from_world_q, keyframe.camera_from_world_t, camera_from_world);
}

// Sorts the events of a log into a mission.
class MissionBuilder {
 public:
  MissionBuilder(Mission* mission, const MissionReadOptions& options)
      : mission_(mission), options_(options), converter_(mission->rig) {}

  void Add(const LogEvent& event) {
    const BusOptions& bus = mission_->rig.bus;
    if (event.channel == bus.pose_channel) {
      Append(event, &mission_->poses);
    } else if (event.channel == bus.status_channel) {
      Append(event, &mission_->statuses);
    } else if (event.channel == bus.water_channel) {
      Append(event, &mission_->waters);
    } else if (event.channel == bus.keyframe_channel) {
      AddKeyframe(event);
    } else if (event.channel == bus.keyframe_poses_channel) {
      AddKeyframePoses(event);
    } else if (event.channel == bus.landmarks_channel) {
      AddLandmarks(event);
    } else {
      AddNav(event);
    }
  }

  void Finish() {
    for (auto& [id, keyframe] : keyframes_) mission_->keyframes.push_back(std::move(keyframe));
    std::stable_sort(mission_->nav.begin(), mission_->nav.end(),
                     [](const NavSample& a, const NavSample& b) { return a.utime < b.utime; });
    mission_->origin = converter_.origin();
  }

 private:
  template <class Message>
  void Append(const LogEvent& event, std::vector<Message>* messages) {
    Message message;
    if (Decode(event.data, &message)) {
      messages->push_back(std::move(message));
    } else {
      ++mission_->num_malformed;
    }
  }

  void AddKeyframe(const LogEvent& event) {
    keyframe_t keyframe;
    if (!Decode(event.data, &keyframe)) {
      ++mission_->num_malformed;
      return;
    }
    if (!options_.keep_descriptors) {
      keyframe.descriptor_type = keyframe_t::DESCRIPTOR_NONE;
      keyframe.descriptor_bytes = keyframe.num_descriptor_bytes = 0;
      keyframe.descriptors = {};
    }
    // An update may come without descriptors, which do not change: the first ones stay.
    keyframe_t& stored = keyframes_[keyframe.id];
    if (keyframe.descriptor_type == keyframe_t::DESCRIPTOR_NONE &&
        stored.num_features == keyframe.num_features) {
      keyframe.descriptor_type = stored.descriptor_type;
      keyframe.descriptor_bytes = stored.descriptor_bytes;
      keyframe.num_descriptor_bytes = stored.num_descriptor_bytes;
      keyframe.descriptors = std::move(stored.descriptors);
    }
    for (const std::int32_t landmark : stored.landmark_id) {
      if (landmark >= 0) std::erase(seen_by_[landmark], stored.id);
    }
    stored = std::move(keyframe);
    for (const std::int32_t landmark : stored.landmark_id) {
      if (landmark >= 0) seen_by_[landmark].push_back(stored.id);
    }
  }

  // What a loop has moved, and the landmarks that no later keyframe has seen with it.
  void AddKeyframePoses(const LogEvent& event) {
    keyframe_poses_t message;
    if (!Decode(event.data, &message)) {
      ++mission_->num_malformed;
      return;
    }
    for (std::size_t i = 0; i < message.id.size(); ++i) {
      const auto at = keyframes_.find(message.id[i]);
      const double q[] = {message.qw[i], message.qx[i], message.qy[i], message.qz[i]};
      const double t[] = {message.tx[i], message.ty[i], message.tz[i]};
      Rigid3 old_from_world, new_from_world;
      if (at == keyframes_.end() || !PoseOf(at->second, &old_from_world)) continue;
      if (!ToPose(q, t, &new_from_world)) continue;
      std::copy_n(q, 4, at->second.camera_from_world_q);
      std::copy_n(t, 3, at->second.camera_from_world_t);
      const Rigid3 new_world_from_world = new_from_world.Inverse() * old_from_world;
      for (const std::int32_t id : at->second.landmark_id) {
        if (id < 0) continue;
        const std::vector<std::int32_t>& seen_by = seen_by_[id];
        if (*std::max_element(seen_by.begin(), seen_by.end()) != message.id[i]) continue;
        const auto landmark = mission_->landmarks.find(id);
        if (landmark == mission_->landmarks.end()) continue;
        landmark->second.xyz = new_world_from_world * landmark->second.xyz;
      }
    }
  }

  void AddLandmarks(const LogEvent& event) {
    landmarks_t message;
    if (!Decode(event.data, &message)) {
      ++mission_->num_malformed;
      return;
    }
    for (std::size_t i = 0; i < message.id.size(); ++i) {
      const Vec3 xyz(message.x[i], message.y[i], message.z[i]);
      if (!xyz.allFinite()) continue;
      mission_->landmarks[message.id[i]] = {xyz, {message.r[i], message.g[i], message.b[i]}};
    }
  }

  void AddNav(const LogEvent& event) {
    for (const BusInput& input : mission_->rig.bus.inputs) {
      if (input.channel != event.channel) continue;
      NavSample sample;
      switch (converter_.Convert(input, event.data, &sample)) {
        case NavDecode::kOk:
          mission_->nav.push_back(sample);
          break;
        case NavDecode::kMalformed:
          ++mission_->num_malformed;
          break;
        case NavDecode::kRejected:
          ++mission_->num_nav_rejected;
          break;
      }
    }
  }

  Mission* mission_;
  MissionReadOptions options_;
  NavConverter converter_;
  std::map<std::int32_t, keyframe_t> keyframes_;
  std::unordered_map<std::int32_t, std::vector<std::int32_t>> seen_by_;  // keyframes of a landmark
};

}  // namespace

MissionWriter::MissionWriter(fs::path folder, EventLogWriter log)
    : folder_(std::move(folder)), log_(std::move(log)) {}

IoExpected<MissionWriter> MissionWriter::Create(const fs::path& folder, const Rig& rig,
                                                const EventLogWriterOptions& options) {
  if (auto status = WriteRig(rig, folder / kRigFile); !status) return Fail(status.error());
  auto log = EventLogWriter::Create(folder / kEventsFile, options);
  if (!log) return Fail(log.error());
  return MissionWriter(folder, std::move(*log));
}

IoStatus MissionWriter::WriteRigFile(const Rig& rig) { return WriteRig(rig, folder_ / kRigFile); }

IoStatus MissionWriter::WriteImageTimes(const std::vector<ImageTime>& images) {
  return rsfm::WriteImageTimes(images, folder_ / kImagesFile);
}

IoStatus MissionWriter::LinkImages(const fs::path& images_folder) {
  std::error_code error;
  const fs::path link = folder_ / kImagesFolder;
  fs::create_directory_symlink(fs::absolute(images_folder), link, error);
  if (error) return Fail(FromErrno(error.value(), link.string(), "link the images"));
  return {};
}

double Mission::IndexWaterAt(Utime utime) const {
  double index = rig.camera.port.index_water;
  for (const water_t& water : waters) {
    // No index that cannot be: what is damaged is not believed.
    if (water.utime <= utime && water.index_water >= 1.0 && water.index_water <= 4.0)
      index = water.index_water;
  }
  return index;
}

fs::path Mission::ImagesFolder() const {
  std::error_code error;
  const fs::path path = folder / kImagesFolder;
  return fs::is_directory(path, error) ? path : fs::path();
}

bool IsMissionFolder(const fs::path& folder) {
  std::error_code error;
  if (fs::exists(folder / kEventsFile, error)) return true;
  return fs::exists(folder / kRigFile, error) && fs::is_directory(folder / kImagesFolder, error);
}

IoExpected<Mission> ReadMission(const fs::path& folder, const MissionReadOptions& options) {
  std::error_code error;
  if (!fs::is_directory(folder, error) || !fs::exists(folder / kRigFile, error)) {
    return Fail({Errc::kNotFound, folder.string(), "", "is not a mission: it has no rig.yaml",
                 "give a folder with rig.yaml and events.lcm"});
  }
  Mission mission;
  mission.folder = folder;
  auto rig = ReadRig(folder / kRigFile);
  if (!rig) return Fail(rig.error());
  mission.rig = std::move(*rig);
  if (const auto bytes = fs::file_size(folder / kImagesFile, error); !error && bytes > 0) {
    auto images = ReadImageTimes(folder / kImagesFile, CutEnd::kDrop);
    if (!images) return Fail(images.error());
    mission.images = std::move(*images);
  }
  auto log = EventLogReader::Open(folder / kEventsFile);
  if (!log) return Fail(log.error());
  MissionBuilder builder(&mission, options);
  LogEvent event;
  while (true) {
    const auto has_event = log->Next(&event);
    if (!has_event) return Fail(has_event.error());
    if (!*has_event) break;
    builder.Add(event);
  }
  builder.Finish();
  mission.log = log->statistics();
  return mission;
}

Model ModelFromMission(const Mission& mission) {
  Model model;
  model.rig = mission.rig;
  model.cameras.push_back({1, mission.rig.camera});
  std::unordered_map<std::int32_t, std::int32_t> point_of_landmark;
  for (const keyframe_t& keyframe : mission.keyframes) {
    ModelImage image;
    if (!PoseOf(keyframe, &image.camera_from_world)) continue;
    image.name =
        keyframe.image.empty() ? "keyframe_" + std::to_string(keyframe.id) : keyframe.image;
    image.utime = keyframe.utime;
    const auto image_index = static_cast<std::int32_t>(model.images.size());
    for (std::size_t f = 0; f < keyframe.x_px.size(); ++f) {
      image.features.emplace_back(keyframe.x_px[f], keyframe.y_px[f]);
      image.points.push_back(kNoPoint);
      const auto landmark = mission.landmarks.find(keyframe.landmark_id[f]);
      if (landmark == mission.landmarks.end()) continue;
      const auto next = static_cast<std::int32_t>(model.points.size());
      const std::int32_t point = point_of_landmark.emplace(landmark->first, next).first->second;
      if (point == next) {
        model.points.push_back({0, landmark->second.xyz, landmark->second.rgb, -1.0, {}});
      }
      auto& track = model.points[static_cast<std::size_t>(point)].track;
      if (!track.empty() && track.back().image == image_index) continue;  // one feature per image
      track.push_back({image_index, static_cast<std::int32_t>(f)});
      image.points.back() = point;
    }
    model.images.push_back(std::move(image));
  }
  return model;
}

}  // namespace rsfm

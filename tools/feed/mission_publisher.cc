#include "tools/feed/mission_publisher.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "rsfm/io/rig_names.h"

namespace rsfm {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

const char* FrameName(bool world_is_ned) { return world_is_ned ? "ned" : "first_camera"; }

void CopyQuat(const Quat& q, double* wxyz) {
  wxyz[0] = q.w();
  wxyz[1] = q.x();
  wxyz[2] = q.y();
  wxyz[3] = q.z();
}

std::array<std::vector<double>*, 7> MovedArrays(keyframe_poses_t* message) {
  return {&message->qw, &message->qx, &message->qy, &message->qz,
          &message->tx, &message->ty, &message->tz};
}

}  // namespace

IoStatus DirectSink::Take(Audience audience, const std::string& channel, Utime utime,
                          std::span<const std::uint8_t> data) {
  if (bus_ != nullptr && audience == Audience::kBusAndLog) bus_->PublishRaw(channel, data);
  return writer_ != nullptr ? writer_->LogRaw(channel, utime, data) : IoStatus();
}

MissionPublisher::MissionPublisher(const Rig& rig, MessageSink* sink,
                                   const PublisherOptions& options)
    : rig_(rig),
      sink_(sink),
      options_(options),
      moved_per_image_(std::max(kMovedPerImage, rig.mapper.max_keyframes)) {
  const auto features = static_cast<std::size_t>(rig.mapper.max_features);
  const auto landmarks = static_cast<std::size_t>(rig.mapper.max_landmarks);
  const auto keyframes = static_cast<std::size_t>(rig.mapper.max_keyframes);
  const std::size_t descriptors =
      features * static_cast<std::size_t>(DescriptorBytes(rig.mapper.descriptor));
  for (std::vector<float>* values : {&keyframe_.x_px, &keyframe_.y_px, &keyframe_.size_px})
    values->reserve(features);
  keyframe_.landmark_id.reserve(features);
  keyframe_.descriptors.reserve(descriptors);
  landmarks_.id.reserve(landmarks);
  for (std::vector<double>* values : {&landmarks_.x, &landmarks_.y, &landmarks_.z})
    values->reserve(landmarks);
  for (std::vector<std::uint8_t>* values : {&landmarks_.r, &landmarks_.g, &landmarks_.b})
    values->reserve(landmarks);
  const auto moved = static_cast<std::size_t>(moved_per_image_);
  moved_.id.reserve(moved);
  for (std::vector<double>* values : MovedArrays(&moved_)) values->reserve(moved);
  constexpr std::size_t kHead = 1024;  // all that is not in arrays
  encoded_.reserve(kHead + std::max({16 * features + descriptors, 31 * landmarks, 60 * moved}));
  keyframe_.image.reserve(kMaxImageName);
  image_of_keyframe_.resize(keyframes);
  for (std::string& name : image_of_keyframe_) name.reserve(kMaxImageName);
}

template <class Message>
IoStatus MissionPublisher::Publish(const std::string& channel, Utime utime, const Message& message,
                                   Audience audience) {
  if (!Encode(message, &encoded_)) {
    return Fail({Errc::kInvalidArgument, "", channel,
                 "the message's arrays do not have the length it states", ""});
  }
  return sink_->Take(audience, channel, utime, encoded_);
}

void AddNavInput(BusOptions* bus) {
  for (const BusInput& input : bus->inputs)
    if (input.type == InputType::kNav) return;
  const auto is_taken = [&](const std::string& channel) {
    bool result = std::any_of(bus->inputs.begin(), bus->inputs.end(),
                              [&](const BusInput& input) { return input.channel == channel; });
    ForEachOutputChannel(*bus, [&](const char*, const std::string& c) { result |= c == channel; });
    return result;
  };
  std::string channel = "RSFM_NAV";
  while (is_taken(channel)) channel += "_";
  bus->inputs.push_back({channel, InputType::kNav, Convention::kRsfm});
}

IoStatus MissionPublisher::PublishNav(const NavSample& sample) {
  // Consumed, not published: it goes to the log alone.
  for (const BusInput& input : rig_.bus.inputs) {
    if (input.type == InputType::kNav)
      return Publish(input.channel, sample.utime, ToMessage(sample), Audience::kLog);
  }
  return {};
}

IoStatus MissionPublisher::PublishWater(Utime utime, const WaterInUse& water) {
  if (rig_.camera.port.type == PortType::kNone || water.index == last_index_water_) return {};
  last_index_water_ = water.index;
  water_t message{};
  message.utime = utime;
  message.index_water = water.index;
  message.is_measured = water.is_measured;
  message.temperature_c = water.is_measured ? water.temperature_c : kNaN;
  message.salinity_psu = water.is_measured ? water.salinity_psu : kNaN;
  message.depth_m = water.is_measured ? water.depth_m : kNaN;
  return Publish(rig_.bus.water_channel, utime, message);
}

IoStatus MissionPublisher::PublishPose(Utime utime, const StepReport& report) {
  pose_t& pose = pose_;
  pose.utime = utime;
  pose.frame_id = FrameName(report.world_is_ned);
  pose.child_frame_id = "body";
  for (double& v : pose.velocity_body_mps) v = kNaN;
  pose.state = static_cast<std::int32_t>(report.state);
  pose.reset_counter = report.reset_counter;
  pose.num_inliers = report.num_inliers;
  pose.scale_is_metric = report.scale_is_metric;
  pose.quality = -1;
  if (report.has_pose) {
    const BodyPose body =
        ToBodyPose(report.camera_from_world, report.covariance, rig_.body_from_camera);
    Vec3::Map(pose.position_m) = body.world_from_body.translation;
    CopyQuat(body.world_from_body.rotation, pose.frame_from_body_q);
    Eigen::Map<Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>(pose.covariance) = body.covariance;
    pose.quality =
        report.state == MapperState::kTracking ? std::clamp(report.num_inliers / 2, 1, 100) : 0;
  } else {
    std::fill_n(pose.position_m, 3, kNaN);
    std::fill_n(pose.frame_from_body_q, 4, kNaN);
    std::fill_n(pose.covariance, 36, 0.0);
    pose.covariance[0] = -1.0;
  }
  return Publish(rig_.bus.pose_channel, utime, pose);
}

IoStatus MissionPublisher::PublishKeyframe(const Map& map, SlotId id, bool with_descriptors,
                                           MapperState state, Utime utime) {
  const Keyframe& keyframe = map.keyframe(id);
  keyframe_t& message = keyframe_;
  message.utime = keyframe.utime;
  message.id = keyframe.id;
  message.image.assign(image_of_keyframe_[id.index]);
  message.state = static_cast<std::int32_t>(keyframe.is_placed ? MapperState::kTracking : state);
  message.reset_counter = keyframe.world;
  std::fill_n(message.camera_from_world_q, 4, 0.0);  // no rotation
  std::fill_n(message.camera_from_world_t, 3, 0.0);
  if (keyframe.is_placed) {
    CopyQuat(keyframe.camera_from_world.rotation, message.camera_from_world_q);
    Vec3::Map(message.camera_from_world_t) = keyframe.camera_from_world.translation;
  }
  message.num_features = keyframe.num_features;
  message.x_px.clear();
  message.y_px.clear();
  message.size_px.clear();
  message.landmark_id.clear();
  message.descriptors.clear();
  message.descriptor_type = keyframe_t::DESCRIPTOR_NONE;
  message.descriptor_bytes = message.num_descriptor_bytes = 0;
  const auto features = map.features(id);
  const auto landmarks = map.landmarks_of(id);
  for (std::size_t i = 0; i < features.size(); ++i) {
    message.x_px.push_back(features[i].x_px);
    message.y_px.push_back(features[i].y_px);
    message.size_px.push_back(features[i].size_px);
    const Landmark* landmark = map.landmarks().Find(landmarks[i]);
    message.landmark_id.push_back(landmark != nullptr ? landmark->id : -1);
  }
  const DescriptorView descriptors = map.descriptors(id);
  if (with_descriptors) {
    message.descriptor_type = static_cast<std::int32_t>(descriptors.type);
    message.descriptor_bytes = DescriptorBytes(descriptors.type);
    for (int i = 0; i < descriptors.count; ++i) {
      message.descriptors.insert(message.descriptors.end(), descriptors.Row(i),
                                 descriptors.Row(i) + message.descriptor_bytes);
    }
    message.num_descriptor_bytes = static_cast<std::int32_t>(message.descriptors.size());
  }
  return Publish(rig_.bus.keyframe_channel, utime, message);
}

IoStatus MissionPublisher::PublishMoved(Utime utime, IncrementalMapper* mapper, bool* has_moved) {
  keyframe_poses_t& message = moved_;
  message.utime = utime;
  message.id.clear();
  for (std::vector<double>* values : MovedArrays(&message)) values->clear();
  mapper->TellMoved(moved_per_image_, [&](std::int32_t id, const Rigid3& camera_from_world) {
    const Quat& q = camera_from_world.rotation;
    const Vec3& t = camera_from_world.translation;
    message.id.push_back(id);
    message.qw.push_back(q.w());
    message.qx.push_back(q.x());
    message.qy.push_back(q.y());
    message.qz.push_back(q.z());
    message.tx.push_back(t.x());
    message.ty.push_back(t.y());
    message.tz.push_back(t.z());
  });
  message.num = static_cast<std::int32_t>(message.id.size());
  *has_moved = message.num > 0;
  if (!*has_moved) return {};
  return Publish(rig_.bus.keyframe_poses_channel, utime, message);
}

IoStatus MissionPublisher::PublishLandmarks(Utime utime, Map* map) {
  landmarks_t& message = landmarks_;
  message.utime = utime;
  message.id.clear();
  for (std::vector<double>* values : {&message.x, &message.y, &message.z}) values->clear();
  for (std::vector<std::uint8_t>* values : {&message.r, &message.g, &message.b}) values->clear();
  map->landmarks().ForEach([&](SlotId, Landmark& landmark) {
    if (!landmark.is_changed) return;
    landmark.is_changed = false;
    message.id.push_back(landmark.id);
    message.x.push_back(landmark.point_in_world.x());
    message.y.push_back(landmark.point_in_world.y());
    message.z.push_back(landmark.point_in_world.z());
    message.r.push_back(landmark.r);
    message.g.push_back(landmark.g);
    message.b.push_back(landmark.b);
  });
  message.num = static_cast<std::int32_t>(message.id.size());
  if (message.num == 0) return {};
  return Publish(rig_.bus.landmarks_channel, utime, message);
}

std::array<std::int64_t*, kNumNavRejects> NavReasons(status_t* status) {
  return {&status->nav_not_finite,     &status->nav_sentinel, &status->nav_out_of_range,
          &status->nav_runs_backwards, &status->nav_repeated, &status->nav_too_late,
          &status->nav_frozen,         &status->nav_jump};
}

namespace {

void FillReasons(const FeedCounters& counters, const IncrementalMapper& mapper, status_t* status) {
  using enum FrameVerdict;
  status->frames_wrong_form = counters.count(kNoImage) + counters.count(kWrongSize);
  status->frames_repeated_time = counters.count(kRepeatedTime);
  status->frames_out_of_order = counters.count(kOutOfOrder);
  status->frames_from_the_future = counters.count(kFromTheFuture);
  status->frames_black = counters.count(kBlack);
  status->frames_white = counters.count(kWhite);
  status->frames_flat = counters.count(kFlat);
  status->frames_torn = counters.count(kTorn);
  status->frames_duplicate = counters.count(kDuplicate);
  const auto reasons = NavReasons(status);
  for (int i = 0; i < kNumNavRejects; ++i) {
    *reasons[static_cast<std::size_t>(i)] =
        static_cast<std::int64_t>(mapper.nav().buffer().rejected(static_cast<NavReject>(i)));
    status->nav_rejected += *reasons[static_cast<std::size_t>(i)];
  }
  status->nav_outliers = mapper.adjuster().num_nav_outliers();
}

}  // namespace

void MissionPublisher::FillStatus(Utime utime, const StepReport& report,
                                  const FeedCounters& counters, const IncrementalMapper& mapper,
                                  status_t* filled) const {
  status_t& status = *filled;
  status = {};
  status.utime = utime;
  status.state = static_cast<std::int32_t>(report.state);
  status.reset_counter = report.reset_counter;
  status.frame_id = FrameName(report.world_is_ned);
  status.origin_is_known = rig_.world.origin.has_value();
  if (rig_.world.origin) {
    status.origin_latitude_deg = rig_.world.origin->latitude_deg;
    status.origin_longitude_deg = rig_.world.origin->longitude_deg;
    status.origin_height_m = rig_.world.origin->height_m;
  }
  status.scale_is_metric = report.scale_is_metric;
  status.frames_received = counters.frames_received;
  status.frames_registered = counters.frames_placed;
  status.frames_late = counters.frames_dropped;
  status.frames_damaged = counters.frames_unusable;
  status.frames_dropped = status.frames_late + status.frames_damaged;
  status.nav_received = counters.nav_received;
  FillReasons(counters, mapper, &status);
  status.num_keyframes = static_cast<std::int32_t>(mapper.map().keyframes().size());
  status.num_landmarks = static_cast<std::int32_t>(mapper.map().landmarks().size());
  status.keyframe_capacity = static_cast<std::int32_t>(mapper.map().keyframe_capacity());
  status.landmark_capacity = static_cast<std::int32_t>(mapper.map().landmarks().capacity());
  status.disk_free_bytes = -1;  // and no clock times: the same input gives the same bytes
}

IoStatus MissionPublisher::PublishStatus(Utime utime, const StepReport& report,
                                         const FeedCounters& counters,
                                         const IncrementalMapper& mapper) {
  if (!options_.publish_status) return {};
  status_t status{};
  FillStatus(utime, report, counters, mapper, &status);
  last_status_utime_ = utime;
  has_status_ = true;
  return Publish(rig_.bus.status_channel, utime, status);
}

IoStatus MissionPublisher::PublishStep(const std::string& image, Utime utime,
                                       const StepReport& report, const FeedCounters& counters,
                                       IncrementalMapper* mapper) {
  if (auto s = PublishWater(utime, mapper->water()); !s) return s;
  if (auto s = PublishPose(utime, report); !s) return s;
  if (auto s = PublishMap(image, utime, report, mapper); !s) return s;
  const bool is_due = utime - last_status_utime_ >= 1'000'000 || utime < last_status_utime_;
  if (!has_status_ || is_due) return PublishStatus(utime, report, counters, *mapper);
  return {};
}

IoStatus MissionPublisher::PublishMap(const std::string& image, Utime utime,
                                      const StepReport& report, IncrementalMapper* mapper) {
  // Keyframes of the map are the newest, told first; then the landmarks that moved with them: so
  // what a reader moves with a keyframe and what is published moved are never the same landmark.
  bool has_moved = false;
  if (auto s = PublishMoved(utime, mapper, &has_moved); !s) return s;
  if (report.keyframe.valid() || has_moved) {
    if (auto s = PublishLandmarks(utime, &mapper->map()); !s) return s;
  }
  if (report.keyframe.valid()) {
    image_of_keyframe_[report.keyframe.index].assign(image);
    if (auto s = PublishKeyframe(mapper->map(), report.keyframe, true, report.state, utime); !s)
      return s;
  }
  const auto update = [&](SlotId id) {
    return id.valid() ? PublishKeyframe(mapper->map(), id, false, report.state, utime) : IoStatus();
  };
  if (auto s = update(report.left_window); !s) return s;
  if (report.left_window.valid()) last_left_window_ = mapper->map().keyframe(report.left_window).id;
  for (const SlotId id : report.placed_late) {
    if (auto s = update(id); !s) return s;
  }
  return {};
}

IoStatus MissionPublisher::PublishEnd(Utime utime, const StepReport& report,
                                      const FeedCounters& counters, IncrementalMapper* mapper) {
  for (bool has_moved = true; has_moved;) {
    if (auto s = PublishMoved(utime, mapper, &has_moved); !s) return s;
  }
  if (auto s = PublishLandmarks(utime, &mapper->map()); !s) return s;
  for (const SlotId id : mapper->map().keyframes()) {
    // Those that left the window have had their last word, while their landmarks were all there.
    if (mapper->map().keyframe(id).id <= last_left_window_) continue;
    if (auto s = PublishKeyframe(mapper->map(), id, false, MapperState::kLost, utime); !s) return s;
  }
  return PublishStatus(utime, report, counters, *mapper);
}

}  // namespace rsfm

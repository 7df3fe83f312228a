#include "tools/map/replay.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <vector>

#include "rsfm/io/nav_messages.h"
#include "tools/feed/mapper_feed.h"
#include "tools/feed/mission_publisher.h"
#include "tools/map/image_files.h"

namespace rsfm {
namespace {

namespace fs = std::filesystem;

// How two messages of one channel differ, for people.
std::string Compare(std::span<const std::uint8_t> recorded, std::span<const std::uint8_t> replayed,
                    bool is_pose) {
  pose_t a, b;
  if (!is_pose || !Decode(recorded, &a) || !Decode(replayed, &b))
    return "its " + std::to_string(recorded.size()) + " bytes are not the same again";
  if (a.utime != b.utime) return "the pose is of another image";
  if (a.state != b.state || a.reset_counter != b.reset_counter)
    return "state " + std::to_string(a.state) + " and reset_counter " +
           std::to_string(a.reset_counter) + " were recorded, " + std::to_string(b.state) +
           " and " + std::to_string(b.reset_counter) + " come out";
  const Vec3 moved = Vec3::Map(a.position_m) - Vec3::Map(b.position_m);
  const double cosine =
      std::abs(Vec4::Map(a.frame_from_body_q).dot(Vec4::Map(b.frame_from_body_q)));
  char text[128];
  std::snprintf(text, sizeof text, "the pose differs by %.3g m and %.3g degrees", moved.norm(),
                2.0 * std::acos(std::min(cosine, 1.0)) * 180.0 / std::numbers::pi);
  return text;
}

// Takes what the publisher says now, and holds it against the log.
class ComparingSink final : public MessageSink {
 public:
  ComparingSink(const BusOptions& bus, EventLogReader log, ReplayResult* result)
      : bus_(bus), log_(std::move(log)), result_(result) {}

  IoStatus Take(Audience, const std::string& channel, Utime utime,
                std::span<const std::uint8_t> data) override {
    if (result_->difference) return {};
    const auto recorded = NextOutput();
    if (!recorded) return Fail(recorded.error());
    if (!*recorded) {
      result_->difference = {last_ + 1, channel, utime, "nothing more was recorded"};
    } else if (event_.channel != channel) {
      Differ(channel + " comes out in its place");
    } else if (!std::equal(data.begin(), data.end(), event_.data.begin(), event_.data.end())) {
      Differ(Compare(event_.data, data, channel == bus_.pose_channel));
    } else {
      ++result_->num_events;
      result_->num_poses += channel == bus_.pose_channel;
    }
    return {};
  }

  IoStatus Finish() {
    if (result_->difference) return {};
    const auto more = NextOutput();
    if (!more) return Fail(more.error());
    if (*more) Differ("nothing comes out for it");
    return {};
  }

 private:
  void Differ(const std::string& what) {
    result_->difference = {event_.number, event_.channel, event_.utime, what};
  }
  IoExpected<bool> NextOutput() {
    while (true) {
      const auto has = log_.Next(&event_);
      if (!has || !*has) return has;
      last_ = event_.number;
      for (const std::string* channel :
           {&bus_.pose_channel, &bus_.keyframe_channel, &bus_.keyframe_poses_channel,
            &bus_.landmarks_channel, &bus_.water_channel})
        if (event_.channel == *channel) return true;
    }
  }

  const BusOptions& bus_;
  EventLogReader log_;
  ReplayResult* result_;
  LogEvent event_;
  std::int64_t last_ = -1;
};

// The navigation between one recorded pose and the next.
class NavBetweenPoses {
 public:
  NavBetweenPoses(const Rig& rig, EventLogReader log)
      : rig_(rig), converter_(rig), log_(std::move(log)) {}

  // Up to the next pose.
  IoStatus Load() {
    pose_utime_.reset();
    LogEvent event;
    while (true) {
      const auto has = log_.Next(&event);
      if (!has) return Fail(has.error());
      if (!*has) return {};
      pose_t pose;
      if (event.channel == rig_.bus.pose_channel && Decode(event.data, &pose)) {
        pose_utime_ = pose.utime;
        pose_event_ = event.number;
        return {};
      }
      for (const BusInput& input : rig_.bus.inputs) {
        NavSample sample;
        if (event.channel == input.channel &&
            converter_.Convert(input, event.data, &sample) == NavDecode::kOk)
          samples_.push_back(sample);
      }
    }
  }

  // Of the image that the log goes on with; none: it has ended.
  std::optional<Utime> pose_utime() const { return pose_utime_; }
  std::int64_t pose_event() const { return pose_event_; }
  void FeedTo(MapperFeed* feed) {
    for (const NavSample& sample : samples_) feed->AddNav(sample);
    samples_.clear();
  }

 private:
  const Rig& rig_;
  NavConverter converter_;
  EventLogReader log_;
  std::vector<NavSample> samples_;
  std::optional<Utime> pose_utime_;
  std::int64_t pose_event_ = 0;
};

IoStatus Replay(const ImageList& list, const std::string& channel, MapperFeed* feed,
                NavBetweenPoses* nav, MissionPublisher* publisher, const MapHooks& hooks,
                ReplayResult* result) {
  ImageReader reader(feed->camera().width(), feed->camera().height());
  if (auto s = nav->Load(); !s) return s;
  Utime last_utime = 0;
  for (const ImageTime& image : list.images) {
    if (hooks.is_interrupted && hooks.is_interrupted()) {
      result->interrupted = true;
      return {};
    }
    if (nav->pose_utime() && *nav->pose_utime() < image.utime) {
      result->difference = {nav->pose_event(), channel, *nav->pose_utime(),
                            "its image is not among the mission's: it was not recorded"};
      return {};
    }
    // Without a pose in the log it was refused then, or the mapper had no time for it.
    if (nav->pose_utime() != image.utime) {
      ++result->num_left_out;
      continue;
    }
    const auto view = reader.Read(list.folder / image.image);
    if (!view) return Fail(view.error());
    nav->FeedTo(feed);
    feed->ExpectImagesUntil(image.utime);  // it was believed then
    if (const auto report = feed->Process(*view, image.utime)) {
      if (auto s = publisher->PublishStep(image.image, image.utime, *report, feed->counters(),
                                          &feed->mapper());
          !s)
        return s;
      if (const auto keyframe = feed->AddKeyframe()) {
        if (auto s = publisher->PublishMap(image.image, image.utime, *keyframe, &feed->mapper());
            !s)
          return s;
      }
    }
    last_utime = image.utime;
    if (result->difference) return {};
    if (auto s = nav->Load(); !s) return s;
    ++result->num_images;
    if (hooks.progress)
      hooks.progress(result->num_images, static_cast<int>(list.images.size()), "the same");
  }
  nav->FeedTo(feed);
  feed->Finish();
  return publisher->PublishEnd(last_utime, feed->last(), feed->counters(), &feed->mapper());
}

}  // namespace

IoExpected<ReplayResult> ReplayMission(const fs::path& mission, const MapHooks& hooks) {
  auto rig = ReadRig(mission / kRigFile);
  if (!rig) return Fail(rig.error());
  const auto list = ListImages(mission, std::nullopt, 1.0);
  if (!list) return Fail(list.error());
  auto outputs = EventLogReader::Open(mission / kEventsFile);
  if (!outputs) return Fail(outputs.error());
  auto inputs = EventLogReader::Open(mission / kEventsFile);
  if (!inputs) return Fail(inputs.error());
  auto feed = MapperFeed::Create(*rig, (mission / kRigFile).string());
  if (!feed) return Fail(feed.error());
  ReplayResult result;
  ComparingSink sink(rig->bus, std::move(*outputs), &result);
  NavBetweenPoses nav(*rig, std::move(*inputs));
  MissionPublisher publisher(*rig, &sink, {.publish_status = false});
  if (auto s = Replay(*list, rig->bus.pose_channel, &*feed, &nav, &publisher, hooks, &result); !s)
    return Fail(s.error());
  if (result.interrupted) return result;
  if (auto s = sink.Finish(); !s) return Fail(s.error());
  return result;
}

}  // namespace rsfm

#include "tools/map/map_images.h"

#include <set>

#include "rsfm/io/atomic_output.h"
#include "rsfm/io/nav_messages.h"
#include "tools/feed/mapper_feed.h"
#include "tools/feed/mission_publisher.h"
#include "tools/map/image_files.h"

namespace rsfm {
namespace {

namespace fs = std::filesystem;

class Feed {
 public:
  IoStatus Open(const MapRequest& request);
  IoExpected<MapResult> Run(const MapHooks& hooks);

 private:
  IoStatus OpenRig();
  IoStatus OpenNav();
  IoStatus OpenMapper();
  IoStatus FeedNav(Utime until);
  IoStatus MapOne(const ImageTime& image);
  void CountPlaced(const StepReport& report, int world_before);
  IoStatus Close(AtomicFolder* folder, MissionWriter* writer, MissionPublisher* publisher);
  MapResult Summary() const;

  MapRequest request_;
  ImageList list_;
  Rig rig_;
  std::vector<NavSample> nav_;
  std::size_t next_nav_ = 0;
  std::optional<NavConverter> converter_;
  std::unique_ptr<LcmBus> bus_;
  std::unique_ptr<ImageReader> reader_;
  std::optional<MapperFeed> feed_;
  MissionPublisher* publisher_ = nullptr;
  MapResult result_;
  std::set<std::int32_t> placed_;  // keyframes of the present world
};

IoStatus Feed::Open(const MapRequest& request) {
  request_ = request;
  auto list = ListImages(request.images, request.times, request.fps.value_or(1.0));
  if (!list) return Fail(list.error());
  list_ = std::move(*list);
  if (auto s = OpenRig(); !s) return s;
  if (auto s = OpenNav(); !s) return s;
  if (auto s = OpenMapper(); !s) return s;
  LcmBusOptions bus;
  bus.url = request.lcm_url;
  auto opened = LcmBus::Create(bus);
  if (!opened) return Fail(opened.error());
  bus_ = std::move(*opened);
  return {};
}

IoStatus Feed::OpenRig() {
  const fs::path path = request_.rig.empty() ? request_.images / kRigFile : request_.rig;
  auto rig = ReadRig(path);
  if (!rig) {
    Diagnostic problem = rig.error();
    if (request_.rig.empty() && problem.code == Errc::kNotFound)
      problem.fix = "give --rig RIG.yaml";
    return Fail(problem);
  }
  rig_ = std::move(*rig);
  return {};
}

IoStatus Feed::OpenNav() {
  const std::optional<fs::path> path = request_.nav ? request_.nav : list_.nav;
  if (!path) return {};
  auto table = ReadNavTable(*path, list_.images, rig_.world.origin);
  if (!table) return Fail(table.error());
  nav_ = std::move(table->samples);
  AddNavInput(&rig_.bus);
  if (!rig_.world.origin) rig_.world.origin = table->origin;
  return {};
}

IoStatus Feed::OpenMapper() {
  const std::string file =
      (request_.rig.empty() ? request_.images / kRigFile : request_.rig).string();
  auto feed = MapperFeed::Create(rig_, file);
  if (!feed) return Fail(feed.error());
  feed_.emplace(std::move(*feed));
  converter_.emplace(rig_);
  feed_->ExpectImagesUntil(list_.images.back().utime);
  reader_ = std::make_unique<ImageReader>(feed_->camera().width(), feed_->camera().height());
  return {};
}

IoStatus Feed::FeedNav(Utime until) {
  for (; next_nav_ < nav_.size() && nav_[next_nav_].utime <= until; ++next_nav_) {
    if (auto s = publisher_->PublishNav(nav_[next_nav_]); !s) return s;
    // As the log has it, to the last bit: a replay has nothing else.
    NavSample logged;
    if (converter_->Convert(ToMessage(nav_[next_nav_]), &logged)) feed_->AddNav(logged);
  }
  return {};
}

IoStatus Feed::MapOne(const ImageTime& image) {
  const auto view = reader_->Read(list_.folder / image.image);
  if (!view) return Fail(view.error());
  if (auto s = FeedNav(image.utime + kNavLeadUs); !s) return s;
  const int world = feed_->last().world;
  const auto report = feed_->Process(*view, image.utime);
  if (!report && feed_->counters().last_frame != FrameVerdict::kGood) return {};  // counted
  if (!report) return Fail(FromError(report.error(), (list_.folder / image.image).string(), ""));
  if (auto s = publisher_->PublishStep(image.image, image.utime, *report, feed_->counters(),
                                       &feed_->mapper());
      !s)
    return s;
  CountPlaced(*report, world);
  const auto keyframe = feed_->AddKeyframe();
  if (!keyframe) return {};
  CountPlaced(*keyframe, report->world);
  return publisher_->PublishMap(image.image, image.utime, *keyframe, &feed_->mapper());
}

void Feed::CountPlaced(const StepReport& report, int world_before) {
  if (report.world != world_before && !report.scale_is_metric) placed_.clear();
  const Map& map = feed_->mapper().map();
  if (report.state == MapperState::kTracking && report.keyframe.valid())
    placed_.insert(map.keyframe(report.keyframe).id);
  for (const SlotId id : report.placed_late) placed_.insert(map.keyframe(id).id);
}

// The world's frame is known now: the rig says it.
IoStatus Feed::Close(AtomicFolder* folder, MissionWriter* writer, MissionPublisher* publisher) {
  const Utime end = list_.images.back().utime;
  feed_->Finish();
  CountPlaced(feed_->last(), feed_->last().world);
  if (auto s = publisher->PublishEnd(end, feed_->last(), feed_->counters(), &feed_->mapper()); !s)
    return s;
  rig_.world.frame = feed_->last().world_is_ned ? WorldFrame::kNed : WorldFrame::kFirstCamera;
  rig_.world.scale_is_metric = feed_->last().scale_is_metric;
  if (auto s = writer->WriteRigFile(rig_); !s) return s;
  if (auto s = writer->WriteImageTimes(list_.images); !s) return s;
  if (auto s = writer->LinkImages(list_.folder); !s) return s;
  if (auto s = writer->Close(); !s) return s;
  return folder->Commit();
}

MapResult Feed::Summary() const {
  MapResult result = result_;
  const StepReport& last = feed_->last();
  const Map& map = feed_->mapper().map();
  result.num_images = static_cast<int>(list_.images.size());
  result.num_placed = static_cast<int>(placed_.size());
  result.num_keyframes = static_cast<int>(map.keyframes().size());
  result.num_landmarks = static_cast<int>(map.landmarks().size());
  result.left_out = DescribeLeftOut(feed_->gate());
  result.num_resets = last.reset_counter;
  result.scale_is_metric = last.scale_is_metric;
  result.world_is_ned = last.world_is_ned;
  result.mean_error_px = last.window_error_px;
  result.front_end_s = feed_->front_end_s();
  result.mapper_s = feed_->mapper_s();
  result.memory_plan_bytes = feed_->memory_plan().total();
  return result;
}

IoExpected<MapResult> Feed::Run(const MapHooks& hooks) {
  auto folder = AtomicFolder::Create(request_.out, Existing::kReplace);
  if (!folder) return Fail(folder.error());
  auto writer = MissionWriter::Create(folder->aside(), rig_);
  if (!writer) return Fail(writer.error());
  DirectSink sink(bus_.get(), &*writer);
  MissionPublisher publisher(rig_, &sink);
  publisher_ = &publisher;
  int done = 0;
  for (const ImageTime& image : list_.images) {
    if (hooks.is_interrupted && hooks.is_interrupted()) {
      result_.interrupted = true;
      return result_;
    }
    if (auto s = MapOne(image); !s) return Fail(s.error());
    if (hooks.progress) {
      hooks.progress(++done, static_cast<int>(list_.images.size()),
                     std::string(ToString(feed_->last().state)) + ", " +
                         std::to_string(feed_->last().num_inliers) + " inliers, " +
                         std::to_string(feed_->mapper().map().landmarks().size()) + " landmarks");
    }
  }
  if (auto s = Close(&*folder, &*writer, &publisher); !s) return Fail(s.error());
  return Summary();
}

}  // namespace

IoExpected<MapResult> MapImages(const MapRequest& request, const MapHooks& hooks) {
  Feed feed;
  if (auto s = feed.Open(request); !s) return Fail(s.error());
  return feed.Run(hooks);
}

}  // namespace rsfm

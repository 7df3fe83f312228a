#include "tools/feed/mapper_feed.h"

#include <chrono>
#include <utility>

namespace rsfm {
namespace {

constexpr Utime kFrozenUs = 1'000'000;  // the same image for so long: the camera sees nothing

double SecondsSince(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

}  // namespace

Diagnostic FromError(const Error& error, const std::string& file, const char* section) {
  return {error.code, file, std::string(section) + error.where,
          std::string("is refused: ") + ToString(error.code), "correct it"};
}

std::string DescribeLeftOut(const FrameGate& gate) {
  std::string text;
  for (int i = 1; i < kNumFrameVerdicts; ++i) {
    const auto verdict = static_cast<FrameVerdict>(i);
    if (gate.count(verdict) == 0) continue;
    if (!text.empty()) text += ", ";
    text += std::to_string(gate.count(verdict)) + " " + std::string(ToString(verdict));
  }
  return text;
}

IoExpected<MapperFeed> MapperFeed::Create(const Rig& rig, const std::string& file) {
  const auto camera = AnyCamera::Create(rig.camera);
  if (!camera) return Fail(FromError(camera.error(), file, "camera: "));
  auto mapper = IncrementalMapper::Create(rig.mapper, *camera, rig.body_from_camera);
  if (!mapper) return Fail(FromError(mapper.error(), file, "mapper."));
  auto front_end = FrontEnd::Create(rig.mapper, camera->width(), camera->height());
  if (!front_end) return Fail(FromError(front_end.error(), file, "mapper."));
  return MapperFeed(rig, *camera, std::move(*front_end), std::move(*mapper));
}

MemoryPlan MapperFeed::memory_plan() const {
  MemoryPlan plan = mapper_->memory_plan();
  plan.items.TryPushBack({"front end", front_end_->bytes()});
  plan.items.TryPushBack({"images' checks and forecasts", gate_.bytes() + predictor_.bytes()});
  return plan;
}

void MapperFeed::AddNav(const NavSample& sample) noexcept {
  mapper_->nav().buffer().Insert(sample);
  gate_.SeeTime(sample.utime);
  ++counters_.nav_received;
}

// Where navigation says the camera has gone since the last image.
std::span<const Vec2> MapperFeed::ExpectPoints(Utime utime) noexcept {
  if (!has_seen_ || !last_.has_pose || !last_.scale_is_metric) return {};
  const auto motion = mapper_->nav().Motion(last_utime_, utime);
  if (!motion) return {};
  return predictor_.Predict(mapper_->map(), camera_, seen_from_world_,
                            motion->start_from_end.Inverse() * last_.camera_from_world);
}

Expected<FrameObservations> MapperFeed::Observe(const ImageView& image, Utime utime) {
  counters_.last_frame = gate_.Check(image, utime);
  ++counters_.verdicts[static_cast<int>(counters_.last_frame)];
  if (gate_.was_set_back()) {
    AwaitAdjustment();
    mapper_->SetClockBack(utime);
    has_seen_ = false;
  }
  switch (counters_.last_frame) {
    case FrameVerdict::kGood:
      return front_end_->Process(image, utime,
                                 {.want_descriptors = mapper_->wants_descriptors(),
                                  .may_describe_later = true,
                                  .expected_px = ExpectPoints(utime)});
    case FrameVerdict::kNoImage:
      return Fail(Errc::kInvalidArgument, "image");
    case FrameVerdict::kWrongSize:
      return Fail(Errc::kInvalidArgument, "size");
    case FrameVerdict::kRepeatedTime:
    case FrameVerdict::kOutOfOrder:
    case FrameVerdict::kFromTheFuture:
      return Fail(Errc::kOutOfOrder, "utime");
    case FrameVerdict::kBlack:
    case FrameVerdict::kWhite:
    case FrameVerdict::kFlat:
    case FrameVerdict::kTorn:
      break;
    case FrameVerdict::kDuplicate:
      if (utime - last_utime_ < kFrozenUs) return Fail(Errc::kNotEnoughData, "duplicate");
      break;
  }
  ++counters_.frames_unusable;
  return FrameObservations{utime, {}, {}};
}

Expected<StepReport> MapperFeed::Process(const ImageView& image, Utime utime) {
  ++counters_.frames_received;
  may_add_keyframe_ = false;
  const auto start = std::chrono::steady_clock::now();
  const auto frame = Observe(image, utime);
  front_end_s_ += SecondsSince(start);
  if (!frame) {
    ++counters_.frames_dropped;
    return tl::unexpected(frame.error());
  }
  const auto step_start = std::chrono::steady_clock::now();
  AwaitAdjustment();
  auto report = mapper_->Step(*frame);
  BeginAdjustment();
  mapper_s_ += SecondsSince(step_start);
  if (!report) return report;
  counters_.frames_placed += report->state == MapperState::kTracking ? 1 : 0;
  last_utime_ = utime;
  Remember(*frame, *report);
  may_add_keyframe_ = report->state == MapperState::kTracking;
  return report;
}

std::optional<StepReport> MapperFeed::AddKeyframe() {
  if (!std::exchange(may_add_keyframe_, false)) return std::nullopt;
  const auto start = std::chrono::steady_clock::now();
  const auto frame = front_end_->Describe();
  front_end_s_ += SecondsSince(start);
  if (!frame || !*frame) return std::nullopt;
  const auto step_start = std::chrono::steady_clock::now();
  const auto report = mapper_->AddKeyframe(**frame);
  BeginAdjustment();
  mapper_s_ += SecondsSince(step_start);
  if (!report) return std::nullopt;
  Remember(**frame, *report);
  return *report;
}

void MapperFeed::Remember(const FrameObservations& frame, const StepReport& report) noexcept {
  last_ = report;
  if (counters_.last_frame != FrameVerdict::kGood) return;
  predictor_.Remember(frame.features);
  has_seen_ = report.has_pose;
  seen_from_world_ = report.camera_from_world;
}

void MapperFeed::BeginAdjustment() noexcept {
  if (adjustment_ != nullptr && mapper_->needs_adjustment()) adjustment_->Start();
}

void MapperFeed::AwaitAdjustment() noexcept {
  if (adjustment_ != nullptr) adjustment_->Wait();
}

void MapperFeed::Finish() {
  AwaitAdjustment();
  last_ = mapper_->Finish();
}

void MapperFeed::AdjustOnThread(std::function<void()> set_up) {
  adjustment_ = std::make_unique<AdjustmentThread>(mapper_.get(), std::move(set_up));
}

}  // namespace rsfm

#include "tools/feed/mapper_feed.h"

#include <chrono>

namespace rsfm {
namespace {

double SecondsSince(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

}  // namespace

Diagnostic FromError(const Error& error, const std::string& file, const char* section) {
  return {error.code, file, std::string(section) + error.where,
          std::string("is refused: ") + ToString(error.code), "correct it"};
}

IoExpected<MapperFeed> MapperFeed::Create(const Rig& rig, const std::string& file) {
  const auto camera = AnyCamera::Create(rig.camera);
  if (!camera) return Fail(FromError(camera.error(), file, "camera: "));
  auto mapper = IncrementalMapper::Create(rig.mapper, *camera, rig.body_from_camera);
  if (!mapper) return Fail(FromError(mapper.error(), file, "mapper."));
  auto front_end = FrontEnd::Create(rig.mapper, camera->width(), camera->height());
  if (!front_end) return Fail(FromError(front_end.error(), file, "mapper."));
  return MapperFeed(*camera, std::move(*front_end), std::move(*mapper));
}

void MapperFeed::AddNav(const NavSample& sample) noexcept {
  mapper_->nav().buffer().Insert(sample);
  ++counters_.nav_received;
}

Expected<StepReport> MapperFeed::Process(const ImageView& image, Utime utime) {
  ++counters_.frames_received;
  const auto start = std::chrono::steady_clock::now();
  const auto frame =
      front_end_->Process(image, utime, {.want_descriptors = mapper_->wants_descriptors()});
  front_end_s_ += SecondsSince(start);
  if (!frame) return tl::unexpected(frame.error());
  const auto step_start = std::chrono::steady_clock::now();
  auto report = mapper_->Step(*frame);
  mapper_s_ += SecondsSince(step_start);
  if (!report) return report;
  counters_.frames_placed += report->state == MapperState::kTracking ? 1 : 0;
  last_ = *report;
  return report;
}

}  // namespace rsfm

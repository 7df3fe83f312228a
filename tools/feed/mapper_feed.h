// The camera, front end and mapper of a rig, and what they have taken so far. One of these is
// behind both feeds: the vehicle's camera and the desk's files.
#pragma once

#include <memory>
#include <string>

#include "rsfm/io/rig.h"
#include "rsfm/mapping/front_end.h"
#include "rsfm/mapping/incremental_mapper.h"

namespace rsfm {

struct FeedCounters {
  std::int64_t frames_received = 0;
  std::int64_t frames_placed = 0;
  std::int64_t frames_dropped = 0;
  std::int64_t nav_received = 0;
};

class MapperFeed {
 public:
  // `file` names the rig in messages. The only place that allocates, OpenCV's buffers in the front
  // end excepted.
  static IoExpected<MapperFeed> Create(const Rig& rig, const std::string& file);

  void AddNav(const NavSample& sample) noexcept;
  // One image through front end and mapper. Errors are theirs; the map is then as it was.
  Expected<StepReport> Process(const ImageView& image, Utime utime);

  IncrementalMapper& mapper() { return *mapper_; }
  const IncrementalMapper& mapper() const { return *mapper_; }
  const AnyCamera& camera() const { return camera_; }
  const FeedCounters& counters() const { return counters_; }
  const StepReport& last() const { return last_; }  // of the last image that was taken
  double front_end_s() const { return front_end_s_; }
  double mapper_s() const { return mapper_s_; }
  std::size_t memory_plan_bytes() const {
    return mapper_->memory_plan().total() + front_end_->bytes();
  }

 private:
  MapperFeed(const AnyCamera& camera, std::unique_ptr<FrontEnd> front_end,
             std::unique_ptr<IncrementalMapper> mapper)
      : camera_(camera), front_end_(std::move(front_end)), mapper_(std::move(mapper)) {}

  AnyCamera camera_;
  std::unique_ptr<FrontEnd> front_end_;
  std::unique_ptr<IncrementalMapper> mapper_;
  FeedCounters counters_;
  StepReport last_;
  double front_end_s_ = 0.0, mapper_s_ = 0.0;
};

// An Error of the SDK as a message about `file`.
Diagnostic FromError(const Error& error, const std::string& file, const char* section);

}  // namespace rsfm

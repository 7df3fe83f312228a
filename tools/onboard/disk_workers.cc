// The threads that write the mission.
#include "tools/onboard/workers.h"

namespace rsfm {
namespace {

// The mission's rig file says what its poses refer to, as soon as that is known.
class WorldWriter {
 public:
  WorldWriter(const Rig& rig, MissionWriter* writer, const Shared* shared)
      : rig_(rig), writer_(writer), shared_(shared), written_(rig.world) {}

  void WriteIfDue(std::int64_t now_us) {
    if (now_us - last_us_ < kPeriodUs) return;
    last_us_ = now_us;
    Write();
  }
  void Write() {
    World world = rig_.world;
    {
      const std::scoped_lock lock(shared_->mutex);
      if (!shared_->has_world) return;
      if (!world.origin) world.origin = shared_->origin;
      world.frame = shared_->world_is_ned ? WorldFrame::kNed : WorldFrame::kFirstCamera;
      world.scale_is_metric = shared_->scale_is_metric;
    }
    if (world.frame == written_.frame && world.scale_is_metric == written_.scale_is_metric &&
        world.origin.has_value() == written_.origin.has_value()) {
      return;
    }
    Rig rig = rig_;
    rig.world = world;
    if (writer_->WriteRigFile(rig)) written_ = world;  // else in a second
  }

 private:
  static constexpr std::int64_t kPeriodUs = 1'000'000;

  const Rig& rig_;
  MissionWriter* writer_;
  const Shared* shared_;
  World written_;
  std::int64_t last_us_ = 0;
};

}  // namespace

void RunLog(const WorkerOptions& options, MissionWriter* writer, Shared* shared) {
  // A log that has lost nothing for so long is well again.
  constexpr std::int64_t kRecoveryUs = 10'000'000;
  SetUpThread("rsfm-log");
  WorldWriter world(options.rig, writer, shared);
  std::int64_t failed_us = -kRecoveryUs;
  while (true) {
    shared->Beat(Worker::kLog);
    QueuedMessage message;
    IoStatus status;
    if (shared->log.Pop(kWaitMs, &message)) {
      status = writer->LogRaw(message.channel, message.utime, message.data);
      shared->log.Release();
    } else if (shared->log.is_closed()) {
      break;
    } else {
      status = writer->log().FlushIfDue();
    }
    const std::int64_t now_us = MonotonicUs();
    world.WriteIfDue(now_us);
    if (!status) failed_us = now_us;
    shared->log_errors = writer->log().num_lost();
    shared->log_is_failing = now_us - failed_us < kRecoveryUs;
  }
  world.Write();
  shared->log_is_whole = writer->Close().has_value() && writer->log().num_lost() == 0;
  shared->log_errors = writer->log().num_lost();
  shared->Rest(Worker::kLog);
}

void RunRecorder(Recorder* recorder, Shared* shared) {
  SetUpThread("rsfm-record");
  for (Frame* frame = nullptr;;) {
    shared->Beat(Worker::kRecord);
    if (shared->record.Pop(kWaitMs, &frame)) {
      recorder->Record(*frame, MonotonicUs());
      FramePool::Release(frame);
    } else if (shared->record.IsFinished()) {
      break;
    }
    recorder->FlushIfDue(MonotonicUs());
  }
  recorder->Flush();
  shared->Rest(Worker::kRecord);
}

}  // namespace rsfm

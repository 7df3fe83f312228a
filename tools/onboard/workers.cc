#include "tools/onboard/workers.h"

#include <algorithm>
#include <cstdio>

namespace rsfm {
namespace {

// The frame is the mapper's from here on, or dropped.
void HandToMapper(const WorkerOptions& options, Frame* frame, Shared* shared) {
  if (options.loses_nothing) {
    while (!shared->frames.PushWait(frame, kWaitMs)) {
      shared->Beat(Worker::kCapture);
      if (!shared->stop) continue;
      FramePool::Release(frame);
      return;
    }
    return;
  }
  Frame* dropped = nullptr;
  if (!shared->frames.PushDropOldest(frame, &dropped)) return;
  FramePool::Release(dropped);
  ++shared->frames_skipped;
}

void HandToRecorder(const WorkerOptions& options, std::int64_t number, Frame* frame,
                    Shared* shared) {
  if (options.is_replay) return;  // the images are there already, with names of their own
  frame->image.clear();
  if (!shared->has_recorder || number % options.rig.onboard.record_every != 0) return;
  Recorder::Name(number, options.rig.onboard.record_lossless, &frame->image);
  FramePool::Retain(frame);
  if (shared->record.TryPush(frame)) return;
  FramePool::Release(frame);
  frame->image.clear();
  ++shared->images_not_queued;
}

void HandOverNav(const WorkerOptions& options, ReplaySource* replay, std::int64_t* count,
                 Shared* shared) {
  NavArrival arrival, dropped;
  arrival.has_sample = true;
  while (replay->NextNav(&arrival.sample)) {
    ++*count;
    if (options.loses_nothing) {
      while (!shared->nav.PushWait(arrival, kWaitMs)) {
        shared->Beat(Worker::kCapture);
        if (shared->stop) return;
      }
    } else if (shared->nav.PushDropOldest(arrival, &dropped)) {
      ++shared->nav_overruns;
    }
  }
}

void TakeNewControls(FrameSource* source, Shared* shared) {
  std::optional<CaptureOptions> controls;
  {
    const std::scoped_lock lock(shared->mutex);
    controls.swap(shared->new_controls);
  }
  if (!controls) return;
  const IoStatus status = source->ChangeControls(*controls);
  const std::scoped_lock lock(shared->mutex);
  shared->control_problem = status ? std::string() : ToString(status.error());
}

// To the queues of bus and log, in the mapper's thread.
class QueueSink final : public MessageSink {
 public:
  QueueSink(const WorkerOptions& options, Shared* shared)
      : is_replay_(options.is_replay), shared_(shared) {}

  // Of the next messages.
  void SetTimes(const MessageTimes& times) { times_ = times; }

  IoStatus Take(Audience audience, const std::string& channel, Utime utime,
                std::span<const std::uint8_t> data) override {
    const Utime log_utime = is_replay_ ? utime : UtcNow();
    if (audience == Audience::kBusAndLog) shared_->bus.Push(channel, log_utime, times_, data);
    if (shared_->has_log) shared_->log.Push(channel, log_utime, {}, data);
    return {};  // what did not fit was counted
  }

 private:
  bool is_replay_;
  Shared* shared_;
  MessageTimes times_;
};

class MapperLoop {
 public:
  MapperLoop(const WorkerOptions& options, MapperFeed* feed, Shared* shared)
      : options_(options),
        feed_(feed),
        shared_(shared),
        sink_(options, shared),
        publisher_(options.rig, &sink_, {.publish_status = false}) {}

  void Run() {
    Report(0);
    for (Frame* frame = nullptr;;) {
      shared_->Beat(Worker::kMapper);
      if (shared_->frames.Pop(kWaitMs, &frame)) {
        DrainNav(frame->nav_until);
        Map(*frame);
        FramePool::Release(frame);
      } else if (shared_->frames.IsFinished()) {
        break;
      } else if (!options_.loses_nothing || (shared_->nav.IsFull() && shared_->frames.IsEmpty())) {
        // Asked in this order: who fills the queue waits, and has no image on the way.
        DrainNav(INT64_MAX);
      }
    }
    DrainNav(INT64_MAX);  // what comes later is of after the mission
    feed_->Finish();
    sink_.SetTimes({});
    static_cast<void>(
        publisher_.PublishEnd(last_utime_, feed_->last(), feed_->counters(), &feed_->mapper()));
    Report(last_utime_);
  }

 private:
  // Of a live bus at most what the queue holds: a flood does not keep the next image waiting.
  void DrainNav(std::int64_t until) {
    NavArrival arrival;
    const std::int64_t end = std::min(until, num_nav_ + options_.rig.onboard.nav_queue);
    while (num_nav_ < (options_.loses_nothing ? until : end) && shared_->nav.Pop(0, &arrival)) {
      ++num_nav_;
      if (!options_.nav_comes_from_file) --shared_->nav_waiting[arrival.input];
      Log(arrival);
      if (!arrival.has_sample) continue;
      feed_->AddNav(arrival.sample);
      if (options_.nav_comes_from_file) static_cast<void>(publisher_.PublishNav(arrival.sample));
    }
  }

  void Log(const NavArrival& arrival) {
    if (arrival.size == 0 || !shared_->has_log) return;
    shared_->log.Push(options_.rig.bus.inputs[arrival.input].channel, arrival.received_utime, {},
                      std::span(arrival.data).first(arrival.size));
  }

  void Map(const Frame& frame) {
    const ImageView view{frame.grey.data(), feed_->camera().width(), feed_->camera().height(),
                         feed_->camera().width(), 1};
    const auto report = feed_->Process(view, frame.utime);
    if (!report) {
      ++shared_->frames_refused;
      return;
    }
    last_utime_ = frame.utime;
    ++shared_->frames_mapped;
    sink_.SetTimes({frame.origin_us, MonotonicUs()});
    static_cast<void>(publisher_.PublishStep(frame.image, frame.utime, *report, feed_->counters(),
                                             &feed_->mapper()));
    if (const auto keyframe = feed_->AddKeyframe())
      static_cast<void>(
          publisher_.PublishMap(frame.image, frame.utime, *keyframe, &feed_->mapper()));
    Report(frame.utime);
  }

  void Report(Utime utime) {
    const std::scoped_lock lock(shared_->mutex);
    const StepReport& last = feed_->last();
    publisher_.FillStatus(utime, last, feed_->counters(), feed_->mapper(), &shared_->vision);
    shared_->world_is_ned = last.world_is_ned;
    shared_->scale_is_metric = last.scale_is_metric;
    shared_->has_world |= last.has_pose;
  }

  const WorkerOptions& options_;
  MapperFeed* feed_;
  Shared* shared_;
  QueueSink sink_;
  MissionPublisher publisher_;
  std::int64_t num_nav_ = 0;
  Utime last_utime_ = 0;
};

}  // namespace

void RunCapture(const WorkerOptions& options, FrameSource* source, Shared* shared) {
  const OnboardOptions& onboard = options.rig.onboard;
  shared->AddThreadProblem(
      SetUpThread("rsfm-capture", onboard.capture_priority, onboard.capture_cpu));
  auto* replay = options.is_replay ? static_cast<ReplaySource*>(source) : nullptr;
  std::int64_t number = 0, num_nav = 0, last_report_us = 0;
  Frame* frame = nullptr;
  while (!shared->stop) {
    shared->Beat(Worker::kCapture);
    TakeNewControls(source, shared);
    // All are out only while the recorder and the mapper hold one each and their queues are full.
    if (frame == nullptr) frame = shared->pool.Acquire();
    if (frame == nullptr) {
      KernelVideoSystem().Wait(1000);
      continue;
    }
    const FrameSource::Result result = source->Next(frame);
    for (const std::string& news : source->TakeNews())
      std::fprintf(stderr, "camera: %s\n", news.c_str());
    const std::int64_t now_us = MonotonicUs();
    if (result != FrameSource::Result::kNothing || now_us - last_report_us > 200'000) {
      last_report_us = now_us;
      const std::scoped_lock lock(shared->mutex);
      shared->source = source->counters();
      shared->source_problem = source->problem();
    }
    if (result == FrameSource::Result::kEnd) break;
    if (result != FrameSource::Result::kFrame) continue;
    if (replay != nullptr) {
      HandOverNav(options, replay, &num_nav, shared);
      frame->nav_until = options.loses_nothing ? num_nav : INT64_MAX;
    }
    HandToRecorder(options, number++, frame, shared);
    HandToMapper(options, frame, shared);
    frame = nullptr;
  }
  if (frame != nullptr) FramePool::Release(frame);
  shared->source_has_ended = true;
  shared->Rest(Worker::kCapture);
  shared->frames.Close();
  shared->record.Close();
}

void RunMapper(const WorkerOptions& options, MapperFeed* feed, Shared* shared) {
  const OnboardOptions& onboard = options.rig.onboard;
  // Begun before this thread is bound to a processor: it would be bound with it. Below the mapper,
  // where that has real-time priority: the next pose goes first.
  feed->AdjustOnThread([&onboard, shared] {
    shared->AddThreadProblem(
        SetUpThread("rsfm-adjust", std::max(0, onboard.mapper_priority - 1), -1));
  });
  shared->AddThreadProblem(SetUpThread("rsfm-mapper", onboard.mapper_priority, onboard.mapper_cpu));
  MapperLoop(options, feed, shared).Run();
  shared->Rest(Worker::kMapper);
}

}  // namespace rsfm

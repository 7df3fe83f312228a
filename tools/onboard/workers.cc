#include "tools/onboard/workers.h"

#include <algorithm>
#include <cstdio>

namespace rsfm {
namespace {

constexpr int kWaitMs = 100;

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

  // What the next messages are about.
  void SetOrigin(std::int64_t origin_us) { origin_us_ = origin_us; }

  IoStatus Take(Audience audience, const std::string& channel, Utime utime,
                std::span<const std::uint8_t> data) override {
    const Utime log_utime = is_replay_ ? utime : UtcNow();
    if (audience == Audience::kBusAndLog) shared_->bus.Push(channel, log_utime, origin_us_, data);
    if (shared_->has_log) shared_->log.Push(channel, log_utime, 0, data);
    return {};  // what did not fit was counted
  }

 private:
  bool is_replay_;
  Shared* shared_;
  std::int64_t origin_us_ = 0;
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
    const StepReport& last = feed_->last();
    sink_.SetOrigin(0);
    static_cast<void>(
        publisher_.PublishEnd(last_utime_, last, feed_->counters(), &feed_->mapper()));
    Report(last_utime_);
    for (NavArrival arrival; shared_->nav.Pop(0, &arrival);) Log(arrival);  // came after the end
  }

 private:
  void DrainNav(std::int64_t until) {
    NavArrival arrival;
    while (num_nav_ < until && shared_->nav.Pop(0, &arrival)) {
      ++num_nav_;
      Log(arrival);
      if (!arrival.has_sample) continue;
      feed_->AddNav(arrival.sample);
      if (options_.nav_comes_from_file) static_cast<void>(publisher_.PublishNav(arrival.sample));
    }
  }

  void Log(const NavArrival& arrival) {
    if (arrival.size == 0 || !shared_->has_log) return;
    shared_->log.Push(options_.rig.bus.inputs[arrival.input].channel, arrival.received_utime, 0,
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
    sink_.SetOrigin(frame.origin_us);
    mapped_us_ = MonotonicUs();
    shared_->bus_latency_origin = mapped_us_;
    static_cast<void>(publisher_.PublishStep(frame.image, frame.utime, *report, feed_->counters(),
                                             &feed_->mapper()));
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
  std::int64_t mapped_us_ = 0;
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
  shared->frames.Close();
  shared->record.Close();
}

void RunMapper(const WorkerOptions& options, MapperFeed* feed, Shared* shared) {
  const OnboardOptions& onboard = options.rig.onboard;
  shared->AddThreadProblem(SetUpThread("rsfm-mapper", onboard.mapper_priority, onboard.mapper_cpu));
  MapperLoop(options, feed, shared).Run();
}

void RunBus(const WorkerOptions& options, LcmBus* bus, Shared* shared) {
  SetUpThread("rsfm-bus");
  std::string channel;
  channel.reserve(64);
  while (true) {
    shared->Beat(Worker::kBus);
    QueuedMessage message;
    if (!shared->bus.Pop(kWaitMs, &message)) {
      if (shared->bus.is_closed()) return;
      continue;
    }
    channel.assign(message.channel);
    bus->PublishRaw(channel, message.data);
    if (message.origin_us > 0 && message.channel == options.rig.bus.pose_channel) {
      const std::int64_t now_us = MonotonicUs();
      shared->latency.Add(now_us, now_us - message.origin_us);
      shared->bus_latency.Add(now_us, now_us - shared->bus_latency_origin);
    }
    shared->publish_errors = bus->counters().publish_errors;
    shared->bus.Release();
  }
}

void RunReceive(const WorkerOptions& options, LcmBus* bus, Shared* shared) {
  SetUpThread("rsfm-receive");
  NavArrival arrival, dropped;
  const NavReceiver receiver(bus, options.rig, [&](const NavMessage& message) {
    arrival.has_sample = message.sample != nullptr;
    if (arrival.has_sample) arrival.sample = *message.sample;
    arrival.input = static_cast<std::uint16_t>(message.input);
    arrival.received_utime = message.received_utime;
    if (message.data.size() <= arrival.data.size()) {
      arrival.size = static_cast<std::uint16_t>(message.data.size());
      std::copy(message.data.begin(), message.data.end(), arrival.data.begin());
    } else {
      arrival.size = 0;
      if (shared->has_log)
        shared->log.Push(options.rig.bus.inputs[message.input].channel, message.received_utime, 0,
                         message.data);
    }
    if (shared->nav.PushDropOldest(arrival, &dropped)) ++shared->nav_overruns;
  });
  bool has_origin = options.rig.world.origin.has_value();
  while (!shared->stop) {
    shared->Beat(Worker::kReceive);
    if (!bus->Handle(kWaitMs)) KernelVideoSystem().Wait(1000 * kWaitMs);  // the network is away
    const LcmBusCounters counters = bus->counters();
    shared->malformed = counters.malformed;
    shared->receive_overruns = counters.overruns;
    shared->nav_unusable = receiver.num_rejected();
    for (int i = 0; i < kNumNavRejects; ++i)
      shared->nav_rejected[static_cast<std::size_t>(i)] =
          static_cast<std::int64_t>(receiver.converter().rejected(static_cast<NavReject>(i)));
    if (!has_origin && receiver.converter().origin()) {
      has_origin = true;
      const std::scoped_lock lock(shared->mutex);
      shared->origin = receiver.converter().origin();
    }
  }
}

void RunLog(MissionWriter* writer, Shared* shared) {
  // A log that has lost nothing for so long is well again.
  constexpr std::int64_t kRecoveryUs = 10'000'000;
  SetUpThread("rsfm-log");
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
    if (!status) failed_us = now_us;
    shared->log_errors = writer->log().num_lost();
    shared->log_is_failing = now_us - failed_us < kRecoveryUs;
  }
  shared->log_is_whole = writer->Close().has_value() && writer->log().num_lost() == 0;
  shared->log_errors = writer->log().num_lost();
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
}

}  // namespace rsfm

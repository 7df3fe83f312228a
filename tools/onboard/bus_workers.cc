// The threads that talk to the bus.
#include <algorithm>

#include "tools/onboard/inbox.h"
#include "tools/onboard/workers.h"

namespace rsfm {
namespace {

// Messages of the bus, and before them the subscriptions, which may take a while to be had.
class Listener {
 public:
  Listener(LcmBus* bus, NavReceiver* receiver, Shared* shared)
      : bus_(bus), receiver_(receiver), shared_(shared) {}

  // Waits no longer than for a message, or for the bus to try itself.
  void Listen() {
    IoStatus status;
    if (!receiver_->is_subscribed() && MonotonicUs() >= retry_at_us_) {
      shared_->Allow(Worker::kReceive, LcmBus::kSelfTestUs);
      status = receiver_->Subscribe();
      retry_at_us_ = MonotonicUs() + retry_after_us_;
      retry_after_us_ = std::min(2 * retry_after_us_, kLastRetryUs);
      Tell(status);
    }
    if (!receiver_->is_subscribed()) {
      KernelVideoSystem().Wait(1000 * kWaitMs);
    } else if (const auto handled = bus_->Handle(kWaitMs); handled) {
      if (is_failing_) Tell({});
    } else {
      if (!is_failing_) Tell(Fail(handled.error()));
      KernelVideoSystem().Wait(1000 * kWaitMs);  // the network is away
    }
  }

 private:
  static constexpr std::int64_t kFirstRetryUs = 1'000'000, kLastRetryUs = 30'000'000;

  void Tell(const IoStatus& status) {
    is_failing_ = !status;
    const std::scoped_lock lock(shared_->mutex);
    shared_->receive_problem =
        status ? std::string() : "no navigation is heard: " + ToString(status.error());
  }

  LcmBus* bus_;
  NavReceiver* receiver_;
  Shared* shared_;
  std::int64_t retry_at_us_ = INT64_MIN, retry_after_us_ = kFirstRetryUs;
  bool is_failing_ = false;
};

}  // namespace

void RunBus(const WorkerOptions& options, LcmBus* bus, Shared* shared) {
  SetUpThread("rsfm-bus");
  std::string channel;
  channel.reserve(64);
  while (true) {
    shared->Beat(Worker::kBus);
    QueuedMessage message;
    if (!shared->bus.Pop(kWaitMs, &message)) {
      if (shared->bus.is_closed()) break;
      continue;
    }
    channel.assign(message.channel);
    bus->PublishRaw(channel, message.data);
    if (message.times.origin_us > 0 && message.channel == options.rig.bus.pose_channel) {
      const std::int64_t now_us = MonotonicUs();
      shared->latency.Add(now_us, now_us - message.times.origin_us);
      shared->bus_latency.Add(now_us, now_us - message.times.ready_us);
    }
    shared->publish_errors = bus->counters().publish_errors;
    shared->bus.Release();
  }
  shared->Rest(Worker::kBus);
}

void RunReceive(const WorkerOptions& options, LcmBus* bus, Shared* shared) {
  SetUpThread("rsfm-receive");
  Inbox inbox(options.rig.bus.inputs, shared);
  NavReceiver receiver(bus, options.rig, [&](const NavMessage& message) { inbox.Take(message); });
  Listener listener(bus, &receiver, shared);
  bool has_origin = options.rig.world.origin.has_value();
  while (!shared->stop) {
    shared->Beat(Worker::kReceive);
    listener.Listen();
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
  shared->Rest(Worker::kReceive);
}

}  // namespace rsfm

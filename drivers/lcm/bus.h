// One bus object over LCM: typed publish and subscribe, with everything that goes wrong counted.
//
// Providers by URL: udpm://239.255.76.67:7667?ttl=0 (multicast), memq:// (within the process),
// file://events.lcm?... (replay or record). One thread handles messages; any thread may publish.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "rsfm/base/time.h"
#include "rsfm/io/diagnostic.h"
#include "rsfm/io/messages.h"
#include "rsfm/io/nav_messages.h"
#include "rsfm/io/rig.h"

namespace rsfm {

struct LcmBusOptions {
  std::string url;  // empty: LCM_DEFAULT_URL, else LCM's own default
  // Socket buffer of udpm where the URL does not name one: images' neighbours on a bus come in
  // bursts that the system's default loses.
  int recv_buf_bytes = 4 << 20;
  // Messages of one channel that wait for Handle(); beyond it the newest are dropped.
  int queue_capacity = 256;
};

struct LcmBusCounters {
  std::int64_t published = 0;
  std::int64_t publish_errors = 0;
  std::int64_t received = 0;
  std::int64_t malformed = 0;  // wrong fingerprint, truncated, impossible counts: dropped
  // How often a channel's queue was found full: at least so many messages were dropped, or would
  // have been with the next one. LCM itself does not say how many.
  std::int64_t overruns = 0;
};

class LcmBus {
 public:
  using RawHandler = std::function<void(std::string_view channel, Utime received_utime,
                                        std::span<const std::uint8_t> data)>;

  static IoExpected<std::unique_ptr<LcmBus>> Create(const LcmBusOptions& options);
  LcmBus(const LcmBus&) = delete;
  LcmBus& operator=(const LcmBus&) = delete;
  ~LcmBus();

  // False, and counted, when LCM refuses. Never waits for a receiver.
  bool PublishRaw(const std::string& channel, std::span<const std::uint8_t> data);
  template <class Message>
  bool Publish(const std::string& channel, const Message& message) {
    std::vector<std::uint8_t> bytes;
    if (Encode(message, &bytes)) return PublishRaw(channel, bytes);
    CountPublishError();
    return false;
  }

  // The channel's name is taken literally. Handlers run within Handle(). kIo where the bus cannot
  // listen: udpm sends itself a message first and waits for it, up to kSelfTestUs; a firewall that
  // drops it, or a network without multicast, fails every subscription. May be tried again.
  static constexpr std::int64_t kSelfTestUs = 10'000'000;
  IoStatus SubscribeRaw(const std::string& channel, RawHandler handler);
  template <class Message>
  IoStatus Subscribe(const std::string& channel,
                     std::function<void(Utime received_utime, const Message&)> handler) {
    return SubscribeRaw(channel,
                        [this, handler = std::move(handler)](std::string_view, Utime received_utime,
                                                             std::span<const std::uint8_t> data) {
                          Message message;
                          if (Decode(data, &message)) {
                            handler(received_utime, message);
                          } else {
                            CountMalformed();
                          }
                        });
  }

  // Waits up to timeout_ms for a message, then handles what is there, at most kMaxPerCall of them,
  // so that a flood cannot keep the caller. How many that were; kIo when the provider fails (a
  // replayed file has ended).
  static constexpr int kMaxPerCall = 4096;
  IoExpected<int> Handle(int timeout_ms);

  LcmBusCounters counters() const;
  void CountMalformed();

 private:
  struct Impl;
  explicit LcmBus(std::unique_ptr<Impl> impl);
  void CountPublishError();

  std::unique_ptr<Impl> impl_;
};

// A message that came on one of a rig's inputs.
struct NavMessage {
  std::size_t input = 0;  // of rig.bus.inputs
  Utime received_utime = 0;
  std::span<const std::uint8_t> data;
  const NavSample* sample = nullptr;  // null: malformed, or nothing in it is usable
};

// Listens to all inputs of a rig and turns them into samples of the body's origin.
class NavReceiver {
 public:
  // Hears nothing until Subscribe(). The handler sees every message, those without a sample too: a
  // mission's log records them all.
  NavReceiver(LcmBus* bus, const Rig& rig, std::function<void(const NavMessage&)> on_message);
  NavReceiver(const NavReceiver&) = delete;
  NavReceiver& operator=(const NavReceiver&) = delete;

  // To the inputs not yet listened to, until one fails: kIo, and another call goes on from there.
  IoStatus Subscribe();
  bool is_subscribed() const { return num_subscribed_ == inputs_.size(); }

  std::int64_t num_samples() const { return num_samples_; }
  std::int64_t num_rejected() const { return num_rejected_; }
  const NavConverter& converter() const { return converter_; }

 private:
  void Take(std::size_t input, Utime received_utime, std::span<const std::uint8_t> data);

  LcmBus* bus_;
  std::vector<BusInput> inputs_;
  NavConverter converter_;
  std::function<void(const NavMessage&)> on_message_;
  std::size_t num_subscribed_ = 0;
  std::int64_t num_samples_ = 0;
  std::int64_t num_rejected_ = 0;
};

}  // namespace rsfm

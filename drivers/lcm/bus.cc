#include "rsfm_drivers/lcm/bus.h"

#include <lcm/lcm.h>

#include <atomic>
#include <cerrno>
#include <cstdlib>
#include <utility>

namespace rsfm {
namespace {

constexpr const char* kDefaultUrl = "udpm://239.255.76.67:7667?ttl=0";

// The URL with a socket buffer, where the provider has one and the URL does not say.
std::string FullUrl(const LcmBusOptions& options) {
  std::string url = options.url;
  if (url.empty()) {
    const char* environment = std::getenv("LCM_DEFAULT_URL");
    url = environment != nullptr && environment[0] != '\0' ? environment : kDefaultUrl;
  }
  if (!url.starts_with("udpm:") || url.find("recv_buf_size") != std::string::npos) return url;
  return url + (url.find('?') == std::string::npos ? "?" : "&") +
         "recv_buf_size=" + std::to_string(options.recv_buf_bytes);
}

// LCM takes channels as regular expressions.
std::string Literal(const std::string& channel) {
  std::string pattern;
  for (const char c : channel) {
    if (std::string_view(".[]{}()\\*+?|^$").find(c) != std::string_view::npos) pattern += '\\';
    pattern += c;
  }
  return pattern;
}

}  // namespace

struct LcmBus::Impl {
  struct Subscription {
    Impl* impl;
    RawHandler handler;
    lcm_subscription_t* handle = nullptr;
    int num_in_pass = 0;  // since the queues were last found empty
  };

  static void OnMessage(const lcm_recv_buf_t* buffer, const char* channel, void* user) {
    auto* subscription = static_cast<Subscription*>(user);
    ++subscription->impl->received;
    // So many without a pause: the queue was full when they began to be taken.
    if (++subscription->num_in_pass == subscription->impl->queue_capacity) {
      ++subscription->impl->overruns;
      subscription->num_in_pass = 0;
    }
    subscription->handler(channel, buffer->recv_utime,
                          std::span(static_cast<const std::uint8_t*>(buffer->data),
                                    static_cast<std::size_t>(buffer->data_size)));
  }

  lcm_t* lcm = nullptr;
  std::string url;
  int queue_capacity = 0;
  std::vector<std::unique_ptr<Subscription>> subscriptions;
  std::atomic<std::int64_t> published = 0, publish_errors = 0, received = 0, malformed = 0,
                            overruns = 0;
};

LcmBus::LcmBus(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}

LcmBus::~LcmBus() {
  for (const auto& subscription : impl_->subscriptions) {
    lcm_unsubscribe(impl_->lcm, subscription->handle);
  }
  lcm_destroy(impl_->lcm);
}

IoExpected<std::unique_ptr<LcmBus>> LcmBus::Create(const LcmBusOptions& options) {
  auto impl = std::make_unique<Impl>();
  impl->url = FullUrl(options);
  impl->queue_capacity = options.queue_capacity;
  impl->lcm = lcm_create(impl->url.c_str());
  if (impl->lcm == nullptr) {
    return Fail({Errc::kInvalidArgument, "", "LCM URL " + impl->url, "cannot be opened",
                 "give memq://, udpm://GROUP:PORT?ttl=0 with multicast allowed, or file://PATH"});
  }
  return std::unique_ptr<LcmBus>(new LcmBus(std::move(impl)));
}

bool LcmBus::PublishRaw(const std::string& channel, std::span<const std::uint8_t> data) {
  const bool is_good = lcm_publish(impl_->lcm, channel.c_str(), data.data(),
                                   static_cast<unsigned int>(data.size())) == 0;
  ++(is_good ? impl_->published : impl_->publish_errors);
  return is_good;
}

void LcmBus::SubscribeRaw(const std::string& channel, RawHandler handler) {
  auto subscription = std::make_unique<Impl::Subscription>();
  subscription->impl = impl_.get();
  subscription->handler = std::move(handler);
  subscription->handle =
      lcm_subscribe(impl_->lcm, Literal(channel).c_str(), Impl::OnMessage, subscription.get());
  lcm_subscription_set_queue_capacity(subscription->handle, impl_->queue_capacity);
  impl_->subscriptions.push_back(std::move(subscription));
}

IoExpected<int> LcmBus::Handle(int timeout_ms) {
  int count = 0;
  for (; count < kMaxPerCall; ++count) {
    const int result = lcm_handle_timeout(impl_->lcm, count == 0 ? timeout_ms : 0);
    if (result < 0 && errno != EINTR) {
      return Fail({Errc::kIo, "", "LCM URL " + impl_->url, "fails while receiving",
                   "see whether its network or file is still there"});
    }
    if (result <= 0) {
      for (const auto& subscription : impl_->subscriptions) subscription->num_in_pass = 0;
      break;
    }
  }
  return count;
}

LcmBusCounters LcmBus::counters() const {
  return {impl_->published, impl_->publish_errors, impl_->received, impl_->malformed,
          impl_->overruns};
}

void LcmBus::CountMalformed() { ++impl_->malformed; }
void LcmBus::CountPublishError() { ++impl_->publish_errors; }

NavReceiver::NavReceiver(LcmBus* bus, const Rig& rig,
                         std::function<void(const NavMessage&)> on_message)
    : converter_(rig), on_message_(std::move(on_message)) {
  for (std::size_t i = 0; i < rig.bus.inputs.size(); ++i) {
    const BusInput& input = rig.bus.inputs[i];
    bus->SubscribeRaw(input.channel, [this, bus, input, i](std::string_view, Utime received_utime,
                                                           std::span<const std::uint8_t> data) {
      NavSample sample;
      const NavDecode decoded = converter_.Convert(input, data, &sample);
      num_samples_ += decoded == NavDecode::kOk;
      num_rejected_ += decoded == NavDecode::kRejected;
      if (decoded == NavDecode::kMalformed) bus->CountMalformed();
      on_message_({i, received_utime, data, decoded == NavDecode::kOk ? &sample : nullptr});
    });
  }
}

}  // namespace rsfm

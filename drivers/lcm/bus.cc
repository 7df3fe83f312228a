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

  // An instance of LCM that has once failed to listen waits for ever in the next attempt (1.3.1):
  // another one takes its place. Of memq and file the one that publishes is the one that hears.
  void RenewReceiver() {
    if (receiver != lcm) lcm_destroy(receiver);
    receiver = url.starts_with("udpm:") ? nullptr : lcm;
  }

  lcm_t* lcm = nullptr;
  lcm_t* receiver = nullptr;  // the same, or the one that took its place; null: to be made
  std::string url;
  int queue_capacity = 0;
  std::vector<std::unique_ptr<Subscription>> subscriptions;
  std::atomic<std::int64_t> published = 0, publish_errors = 0, received = 0, malformed = 0,
                            overruns = 0;
};

LcmBus::LcmBus(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}

LcmBus::~LcmBus() {
  for (const auto& subscription : impl_->subscriptions) {
    lcm_unsubscribe(impl_->receiver, subscription->handle);
  }
  if (impl_->receiver != impl_->lcm && impl_->receiver != nullptr) lcm_destroy(impl_->receiver);
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
  impl->receiver = impl->lcm;
  return std::unique_ptr<LcmBus>(new LcmBus(std::move(impl)));
}

bool LcmBus::PublishRaw(const std::string& channel, std::span<const std::uint8_t> data) {
  const bool is_good = lcm_publish(impl_->lcm, channel.c_str(), data.data(),
                                   static_cast<unsigned int>(data.size())) == 0;
  ++(is_good ? impl_->published : impl_->publish_errors);
  return is_good;
}

IoStatus LcmBus::SubscribeRaw(const std::string& channel, RawHandler handler) {
  auto subscription = std::make_unique<Impl::Subscription>();
  subscription->impl = impl_.get();
  subscription->handler = std::move(handler);
  if (impl_->receiver == nullptr) impl_->receiver = lcm_create(impl_->url.c_str());
  if (impl_->receiver != nullptr) {
    subscription->handle = lcm_subscribe(impl_->receiver, Literal(channel).c_str(), Impl::OnMessage,
                                         subscription.get());
  }
  if (subscription->handle == nullptr) {
    if (impl_->receiver != nullptr && impl_->subscriptions.empty()) impl_->RenewReceiver();
    return Fail({Errc::kIo, "", "LCM URL " + impl_->url, "does not let us listen on " + channel,
                 "let multicast to its group and port come in (a firewall may drop it), or see "
                 "whether its file is still there"});
  }
  lcm_subscription_set_queue_capacity(subscription->handle, impl_->queue_capacity);
  impl_->subscriptions.push_back(std::move(subscription));
  return {};
}

IoExpected<int> LcmBus::Handle(int timeout_ms) {
  int count = 0;
  for (; count < kMaxPerCall; ++count) {
    const int result = impl_->receiver == nullptr
                           ? -1
                           : lcm_handle_timeout(impl_->receiver, count == 0 ? timeout_ms : 0);
    if (result < 0 && (impl_->receiver == nullptr || errno != EINTR)) {
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
    : bus_(bus), inputs_(rig.bus.inputs), converter_(rig), on_message_(std::move(on_message)) {}

IoStatus NavReceiver::Subscribe() {
  for (; num_subscribed_ < inputs_.size(); ++num_subscribed_) {
    auto status =
        bus_->SubscribeRaw(inputs_[num_subscribed_].channel,
                           [this, i = num_subscribed_](std::string_view, Utime received_utime,
                                                       std::span<const std::uint8_t> data) {
                             Take(i, received_utime, data);
                           });
    if (!status) return status;
  }
  return {};
}

void NavReceiver::Take(std::size_t input, Utime received_utime,
                       std::span<const std::uint8_t> data) {
  NavSample sample;
  const NavDecode decoded = converter_.Convert(inputs_[input], data, &sample);
  num_samples_ += decoded == NavDecode::kOk;
  num_rejected_ += decoded == NavDecode::kRejected;
  if (decoded == NavDecode::kMalformed) bus_->CountMalformed();
  on_message_({input, received_utime, data, decoded == NavDecode::kOk ? &sample : nullptr});
}

}  // namespace rsfm

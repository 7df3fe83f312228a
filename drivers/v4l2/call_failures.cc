#include "rsfm_drivers/v4l2/call_failures.h"

#include <cerrno>
#include <cstring>
#include <string_view>

namespace rsfm {

bool IsAbsent(int error) { return error == EINVAL || error == ENOTTY; }

std::string ToString(const CallFailure& failure) {
  return std::string("cannot do ") + failure.call + ": " + std::strerror(failure.error);
}

void CallFailures::Add(const char* call, int error, std::int64_t count) noexcept {
  for (std::size_t i = 0; i < failures_.size(); ++i) {
    if (failures_[i].error != error || std::string_view(failures_[i].call) != call) continue;
    failures_[i].count += count;
    return;
  }
  static_cast<void>(failures_.TryPushBack({call, error, count}));
}

void CallFailures::Take(CallFailures* others) noexcept {
  for (std::size_t i = 0; i < others->failures_.size(); ++i)
    Add((*others)[i].call, (*others)[i].error, (*others)[i].count);
  others->failures_.clear();
}

}  // namespace rsfm

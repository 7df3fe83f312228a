// System calls that failed without stopping the camera: what an optional feature of a device is
// refused with. Each is kept once, by its name and errno.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "rsfm/base/static_vector.h"

namespace rsfm {

// What a device says of an ioctl, control or event that it does not have.
bool IsAbsent(int error);  // EINVAL, ENOTTY

struct CallFailure {
  const char* call = "";  // "VIDIOC_S_CTRL (exposure_auto)"; lives as long as the program
  int error = 0;
  std::int64_t count = 0;
};
// "cannot do VIDIOC_S_CTRL (exposure_auto): Input/output error": without the count.
std::string ToString(const CallFailure& failure);

class CallFailures {
 public:
  static constexpr std::size_t kCapacity = 32;  // of different ones; more of them are left out

  void Add(const char* call, int error, std::int64_t count = 1) noexcept;
  // Takes all of `others`, which is empty afterwards.
  void Take(CallFailures* others) noexcept;

  std::size_t size() const { return failures_.size(); }
  const CallFailure& operator[](std::size_t i) const { return failures_[i]; }

 private:
  StaticVector<CallFailure, kCapacity> failures_;
};

}  // namespace rsfm

// Controls of a camera: exposure, gain, triggers and whatever else rig.yaml names.
#include <linux/videodev2.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdlib>
#include <cstring>

#include "rsfm_drivers/v4l2/video_device.h"

namespace rsfm {
namespace {

constexpr int kMaxControls = 512;
constexpr double kExposureUnitUs = 100.0;  // of V4L2_CID_EXPOSURE_ABSOLUTE

// "Exposure Time, Absolute" to "exposure_time_absolute".
std::string PlainName(const char* name) {
  std::string plain;
  for (const char* c = name; *c != '\0'; ++c) {
    const bool is_upper = *c >= 'A' && *c <= 'Z';
    const bool is_word = is_upper || (*c >= 'a' && *c <= 'z') || (*c >= '0' && *c <= '9');
    if (is_word) {
      plain += static_cast<char>(is_upper ? *c - 'A' + 'a' : *c);
    } else if (!plain.empty() && plain.back() != '_') {
      plain += '_';
    }
  }
  if (!plain.empty() && plain.back() == '_') plain.pop_back();
  return plain;
}

bool IsPlainNumber(std::uint32_t type) {
  return type == V4L2_CTRL_TYPE_INTEGER || type == V4L2_CTRL_TYPE_BOOLEAN ||
         type == V4L2_CTRL_TYPE_MENU || type == V4L2_CTRL_TYPE_INTEGER_MENU ||
         type == V4L2_CTRL_TYPE_BITMASK;
}

}  // namespace

std::vector<ControlInfo> ListControls(VideoSystem* system, int fd) {
  std::vector<ControlInfo> controls;
  v4l2_queryctrl query = {};
  for (int i = 0; i < kMaxControls; ++i) {
    query.id |= V4L2_CTRL_FLAG_NEXT_CTRL;
    if (system->Ioctl(fd, VIDIOC_QUERYCTRL, &query) != 0) break;
    if (!IsPlainNumber(query.type) || (query.flags & V4L2_CTRL_FLAG_DISABLED) != 0) continue;
    const char* name = reinterpret_cast<const char*>(query.name);
    ControlInfo info;
    info.id = query.id;
    info.name = PlainName(std::string(name, ::strnlen(name, sizeof query.name)).c_str());
    info.minimum = query.minimum;
    info.maximum = query.maximum;
    info.step = query.step;
    info.default_value = query.default_value;
    info.is_writable = (query.flags & (V4L2_CTRL_FLAG_READ_ONLY | V4L2_CTRL_FLAG_GRABBED |
                                       V4L2_CTRL_FLAG_INACTIVE)) == 0;
    v4l2_control control = {query.id, 0};
    if (system->Ioctl(fd, VIDIOC_G_CTRL, &control) == 0) info.value = control.value;
    controls.push_back(std::move(info));
  }
  return controls;
}

IoStatus VideoDevice::Set(std::uint32_t id, std::int64_t value, const std::string& field) {
  v4l2_queryctrl query = {};
  query.id = id;
  if (const int error = system_->Ioctl(fd_.get(), VIDIOC_QUERYCTRL, &query); error != 0) {
    if (error != EINVAL && error != ENOTTY)
      return Fail(FromErrno(error, path_, "do VIDIOC_QUERYCTRL (" + field + ")"));
    return Fail({Errc::kUnsupported, path_, field, "is no control of this device",
                 "take it out of rig.yaml; rsfm_tool camera info lists what there is"});
  }
  if (value < query.minimum || value > query.maximum) {
    return Fail({Errc::kInvalidArgument, path_, field,
                 std::to_string(value) + " is beyond what the device takes",
                 "give " + std::to_string(query.minimum) + " to " + std::to_string(query.maximum) +
                     " of its own units"});
  }
  v4l2_control control = {id, static_cast<std::int32_t>(value)};
  if (const int error = system_->Ioctl(fd_.get(), VIDIOC_S_CTRL, &control); error != 0)
    return Fail(FromErrno(error, path_, "do VIDIOC_S_CTRL (" + field + ")"));
  return {};
}

IoStatus VideoDevice::SetExposure(double exposure_us) {
  if (exposure_us <= 0.0) {
    // Aperture priority is what cameras without an iris call automatic.
    v4l2_control control = {V4L2_CID_EXPOSURE_AUTO, V4L2_EXPOSURE_APERTURE_PRIORITY};
    if (system_->Ioctl(fd_.get(), VIDIOC_S_CTRL, &control) == 0) return {};
    control.value = V4L2_EXPOSURE_AUTO;
    system_->Ioctl(fd_.get(), VIDIOC_S_CTRL,
                   &control);  // a device without it has nothing to switch
    return {};
  }
  v4l2_control control = {V4L2_CID_EXPOSURE_AUTO, V4L2_EXPOSURE_MANUAL};
  system_->Ioctl(fd_.get(), VIDIOC_S_CTRL, &control);  // some are always manual
  return Set(V4L2_CID_EXPOSURE_ABSOLUTE, std::llround(exposure_us / kExposureUnitUs),
             "capture.exposure_us");
}

IoStatus VideoDevice::SetGain(double gain) {
  v4l2_control control = {V4L2_CID_AUTOGAIN, gain < 0.0};
  system_->Ioctl(fd_.get(), VIDIOC_S_CTRL, &control);  // not every device has an automatic
  if (gain < 0.0) return {};
  v4l2_queryctrl query = {};
  query.id = V4L2_CID_GAIN;
  const bool has_gain = system_->Ioctl(fd_.get(), VIDIOC_QUERYCTRL, &query) == 0;
  return Set(has_gain ? V4L2_CID_GAIN : V4L2_CID_ANALOGUE_GAIN, std::llround(gain), "capture.gain");
}

IoStatus VideoDevice::SetControls(const CaptureOptions& options) {
  if (auto s = SetExposure(options.exposure_us); !s) return s;
  if (auto s = SetGain(options.gain); !s) return s;
  if (options.controls.empty()) return {};
  const std::vector<ControlInfo> known = ListControls(system_, fd_.get());
  for (const auto& [name, value] : options.controls) {
    const std::string field = "capture.controls." + name;
    const auto number = name.starts_with("0x") ? std::strtoul(name.c_str() + 2, nullptr, 16) : 0;
    const auto found = std::find_if(known.begin(), known.end(), [&](const ControlInfo& info) {
      return info.name == name || (number != 0 && info.id == number);
    });
    if (found == known.end()) {
      return Fail({Errc::kUnsupported, path_, field, "is no control of this device",
                   "take it out of rig.yaml; rsfm_tool camera info lists what there is"});
    }
    if (auto s = Set(found->id, value, field); !s) return s;
  }
  return {};
}

double VideoDevice::ExposureUs() noexcept {
  if (!has_exposure_) return 0.0;
  v4l2_control control = {V4L2_CID_EXPOSURE_ABSOLUTE, 0};
  has_exposure_ = system_->Ioctl(fd_.get(), VIDIOC_G_CTRL, &control) == 0 && control.value >= 0;
  return has_exposure_ ? kExposureUnitUs * control.value : 0.0;
}

}  // namespace rsfm

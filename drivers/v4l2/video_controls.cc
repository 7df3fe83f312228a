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

struct Range {
  std::int64_t minimum, maximum;
};
// A bit mask is unsigned, although its fields are not.
Range RangeOf(const v4l2_queryctrl& query) {
  if (query.type == V4L2_CTRL_TYPE_BITMASK) return {0, static_cast<std::uint32_t>(query.maximum)};
  return {query.minimum, query.maximum};
}

bool IsPlainNumber(std::uint32_t type) {
  return type == V4L2_CTRL_TYPE_INTEGER || type == V4L2_CTRL_TYPE_BOOLEAN ||
         type == V4L2_CTRL_TYPE_MENU || type == V4L2_CTRL_TYPE_INTEGER_MENU ||
         type == V4L2_CTRL_TYPE_BITMASK;
}

}  // namespace

// A control that chooses between automatic and manual, and what its calls are named.
struct VideoDevice::SwitchCalls {
  std::uint32_t id;
  const char *query, *set;
};

std::vector<ControlInfo> ListControls(VideoSystem* system, int fd, CallFailures* failures) {
  std::vector<ControlInfo> controls;
  v4l2_queryctrl query = {};
  for (int i = 0; i < kMaxControls; ++i) {
    query.id |= V4L2_CTRL_FLAG_NEXT_CTRL;
    if (const int error = system->Ioctl(fd, VIDIOC_QUERYCTRL, &query); error != 0) {
      if (!IsAbsent(error)) failures->Add("VIDIOC_QUERYCTRL", error);
      break;
    }
    if (!IsPlainNumber(query.type) || (query.flags & V4L2_CTRL_FLAG_DISABLED) != 0) continue;
    const char* name = reinterpret_cast<const char*>(query.name);
    ControlInfo info;
    info.id = query.id;
    info.name = PlainName(std::string(name, ::strnlen(name, sizeof query.name)).c_str());
    const Range range = RangeOf(query);
    info.minimum = range.minimum;
    info.maximum = range.maximum;
    info.step = query.step;
    info.default_value = query.default_value;
    info.is_writable = (query.flags & (V4L2_CTRL_FLAG_READ_ONLY | V4L2_CTRL_FLAG_GRABBED |
                                       V4L2_CTRL_FLAG_INACTIVE)) == 0;
    v4l2_control control = {query.id, 0};
    const bool is_write_only = (query.flags & V4L2_CTRL_FLAG_WRITE_ONLY) != 0;
    const int error = is_write_only ? 0 : system->Ioctl(fd, VIDIOC_G_CTRL, &control);
    if (error != 0) failures->Add("VIDIOC_G_CTRL", error);
    if (error == 0) {
      info.value = query.type == V4L2_CTRL_TYPE_BITMASK ? static_cast<std::uint32_t>(control.value)
                                                        : std::int64_t{control.value};
    }
    controls.push_back(std::move(info));
  }
  return controls;
}

IoStatus VideoDevice::Set(std::uint32_t id, std::int64_t value, const std::string& field) {
  v4l2_queryctrl query = {};
  query.id = id;
  if (const int error = system_->Ioctl(fd_.get(), VIDIOC_QUERYCTRL, &query); error != 0) {
    if (!IsAbsent(error))
      return Fail(FromErrno(error, path_, "do VIDIOC_QUERYCTRL (" + field + ")"));
    return Fail({Errc::kUnsupported, path_, field, "is no control of this device",
                 "take it out of rig.yaml; rsfm_tool camera info lists what there is"});
  }
  const Range range = RangeOf(query);
  if (value < range.minimum || value > range.maximum) {
    return Fail({Errc::kInvalidArgument, path_, field,
                 std::to_string(value) + " is beyond what the device takes",
                 "give " + std::to_string(range.minimum) + " to " + std::to_string(range.maximum) +
                     " of its own units"});
  }
  v4l2_control control = {id, static_cast<std::int32_t>(value)};
  if (const int error = system_->Ioctl(fd_.get(), VIDIOC_S_CTRL, &control); error != 0)
    return Fail(FromErrno(error, path_, "do VIDIOC_S_CTRL (" + field + ")"));
  return {};
}

std::optional<CallFailure> VideoDevice::Switch(const SwitchCalls& calls,
                                               std::int32_t value) noexcept {
  v4l2_queryctrl query = {};
  query.id = calls.id;
  if (const int error = system_->Ioctl(fd_.get(), VIDIOC_QUERYCTRL, &query); error != 0)
    return IsAbsent(error) ? std::nullopt : std::optional(CallFailure{calls.query, error, 1});
  v4l2_control control = {calls.id, value};
  const int error = system_->Ioctl(fd_.get(), VIDIOC_S_CTRL, &control);
  if (error == 0) return std::nullopt;
  // Some have no choice, and are as they should be.
  control.value = 0;
  if (system_->Ioctl(fd_.get(), VIDIOC_G_CTRL, &control) == 0 && control.value == value)
    return std::nullopt;
  return CallFailure{calls.set, error, 1};
}

// No camera ends for want of an automatic; that it has gone is another matter.
IoStatus VideoDevice::Report(const std::optional<CallFailure>& failure) {
  if (!failure) return {};
  if (failure->error == ENODEV)
    return Fail(FromErrno(failure->error, path_, std::string("do ") + failure->call));
  failures_.Add(failure->call, failure->error);
  return {};
}

IoStatus VideoDevice::MustSwitch(const SwitchCalls& calls, std::int32_t value, const char* field) {
  const auto failure = Switch(calls, value);
  if (!failure) return {};
  Diagnostic problem = FromErrno(failure->error, path_, std::string("do ") + failure->call);
  problem.field = field;
  return Fail(std::move(problem));
}

IoStatus VideoDevice::SetExposure(double exposure_us) {
  constexpr SwitchCalls kAuto = {V4L2_CID_EXPOSURE_AUTO, "VIDIOC_QUERYCTRL (exposure_auto)",
                                 "VIDIOC_S_CTRL (exposure_auto)"};
  if (exposure_us <= 0.0) {
    // Aperture priority is what cameras without an iris call automatic; others do not know it.
    auto failure = Switch(kAuto, V4L2_EXPOSURE_APERTURE_PRIORITY);
    if (failure && (failure->error == EINVAL || failure->error == ERANGE))
      failure = Switch(kAuto, V4L2_EXPOSURE_AUTO);
    return Report(failure);
  }
  const std::string field = "capture.exposure_us";
  if (auto s = MustSwitch(kAuto, V4L2_EXPOSURE_MANUAL, field.c_str()); !s) return s;
  const std::int64_t units = std::llround(exposure_us / kExposureUnitUs);
  if (auto s = Set(V4L2_CID_EXPOSURE_ABSOLUTE, units, field); !s) return s;
  exposure_us_ = kExposureUnitUs * static_cast<double>(units);
  return {};
}

IoStatus VideoDevice::SetGain(double gain) {
  constexpr SwitchCalls kAuto = {V4L2_CID_AUTOGAIN, "VIDIOC_QUERYCTRL (autogain)",
                                 "VIDIOC_S_CTRL (autogain)"};
  if (gain < 0.0) return Report(Switch(kAuto, 1));
  if (auto s = MustSwitch(kAuto, 0, "capture.gain"); !s) return s;
  v4l2_queryctrl query = {};
  query.id = V4L2_CID_GAIN;
  const int error = system_->Ioctl(fd_.get(), VIDIOC_QUERYCTRL, &query);
  return Set(IsAbsent(error) ? V4L2_CID_ANALOGUE_GAIN : V4L2_CID_GAIN, std::llround(gain),
             "capture.gain");
}

IoStatus VideoDevice::SetControls(const CaptureOptions& options) {
  if (auto s = SetExposure(options.exposure_us); !s) return s;
  if (auto s = SetGain(options.gain); !s) return s;
  if (options.controls.empty()) return {};
  const std::vector<ControlInfo> known = ListControls(system_, fd_.get(), &failures_);
  for (const auto& [name, value] : options.controls) {
    const std::string field = "capture.controls." + name;
    const auto number = name.starts_with("0x") ? std::strtoul(name.c_str() + 2, nullptr, 16) : 0;
    const auto found =
        std::find_if(known.begin(), known.end(), [&, &wanted = name](const auto& info) {
          return info.name == wanted || (number != 0 && info.id == number);
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
  const int error = system_->Ioctl(fd_.get(), VIDIOC_G_CTRL, &control);
  if (error == 0 && control.value >= 0) {
    exposure_us_ = kExposureUnitUs * control.value;
  } else if (IsAbsent(error)) {
    has_exposure_ = false;
    exposure_us_ = 0.0;
  } else if (error != 0) {  // this once: the value before is nearer than none
    failures_.Add("VIDIOC_G_CTRL (exposure_absolute)", error);
  }
  return exposure_us_;
}

}  // namespace rsfm

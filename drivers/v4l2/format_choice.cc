#include "rsfm_drivers/v4l2/format_choice.h"

#include <linux/videodev2.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <optional>

namespace rsfm {
namespace {

constexpr int kMaxListed = 64;       // of anything a device lists: a broken one must not hold us
constexpr double kRateSlack = 0.98;  // 29.97 serves for 30

struct Fourcc {
  std::uint32_t fourcc;
  PixelFormat format;
};
constexpr std::array<Fourcc, 10> kFourccs = {{{V4L2_PIX_FMT_GREY, PixelFormat::kGrey},
                                              {V4L2_PIX_FMT_Y16, PixelFormat::kY16},
                                              {V4L2_PIX_FMT_Y10, PixelFormat::kY10},
                                              {V4L2_PIX_FMT_NV12, PixelFormat::kNv12},
                                              {V4L2_PIX_FMT_YUYV, PixelFormat::kYuyv},
                                              {V4L2_PIX_FMT_SBGGR8, PixelFormat::kBayer8},
                                              {V4L2_PIX_FMT_SGBRG8, PixelFormat::kBayer8},
                                              {V4L2_PIX_FMT_SGRBG8, PixelFormat::kBayer8},
                                              {V4L2_PIX_FMT_SRGGB8, PixelFormat::kBayer8},
                                              {V4L2_PIX_FMT_MJPEG, PixelFormat::kMjpeg}}};

double Rate(const v4l2_fract& period) {
  return period.numerator == 0 ? 0.0 : static_cast<double>(period.denominator) / period.numerator;
}

v4l2_format MakeFormat(std::uint32_t fourcc, int width, int height) {
  v4l2_format format = {};
  format.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
  format.fmt.pix.width = static_cast<std::uint32_t>(width);
  format.fmt.pix.height = static_cast<std::uint32_t>(height);
  format.fmt.pix.pixelformat = fourcc;
  format.fmt.pix.field = V4L2_FIELD_NONE;
  return format;
}

// Two half images of two moments. Some drivers leave the field at 0, "any", for whole ones.
bool IsInterlaced(const v4l2_format& format) {
  return format.fmt.pix.field != V4L2_FIELD_NONE && format.fmt.pix.field != V4L2_FIELD_ANY;
}

Diagnostic Interlaced(const std::string& device, const v4l2_format& format) {
  return {Errc::kUnsupported, device, "capture.format",
          "gives interlaced images of " + std::to_string(format.fmt.pix.width) + " x " +
              std::to_string(format.fmt.pix.height) + " px only (V4L2 field " +
              std::to_string(format.fmt.pix.field) + "): the rows of one are of two moments",
          "choose a progressive mode or size of the camera"};
}

bool Is(const v4l2_format& format, std::uint32_t fourcc, int width, int height) {
  return format.fmt.pix.pixelformat == fourcc &&
         format.fmt.pix.width == static_cast<std::uint32_t>(width) &&
         format.fmt.pix.height == static_cast<std::uint32_t>(height);
}

// The formats to try, best first.
std::vector<std::uint32_t> Candidates(const std::vector<std::uint32_t>& offered,
                                      PixelFormat wanted) {
  std::vector<std::uint32_t> candidates;
  for (const Fourcc& entry : kFourccs) {
    if (wanted != PixelFormat::kAuto && entry.format != wanted) continue;
    if (offered.empty() || std::find(offered.begin(), offered.end(), entry.fourcc) != offered.end())
      candidates.push_back(entry.fourcc);
  }
  return candidates;
}

std::string Offer(VideoSystem* system, int fd, const std::vector<std::uint32_t>& offered,
                  CallFailures* failures) {
  std::string text;
  for (const std::uint32_t fourcc : offered) {
    text += (text.empty() ? "" : ", ") + FourccName(fourcc);
    int listed = 0;
    for (const FrameSize& size : ListSizes(system, fd, fourcc, failures)) {
      if (++listed > 6) {
        text += " ...";
        break;
      }
      text += std::string(size.is_range ? " up to " : " ") + std::to_string(size.width) + "x" +
              std::to_string(size.height);
    }
  }
  return text.empty() ? "nothing it would name" : text;
}

IoStatus SetRate(VideoSystem* system, int fd, const std::string& device, CallFailures* failures,
                 StreamFormat* stream) {
  v4l2_streamparm parameters = {};
  parameters.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
  if (const int error = system->Ioctl(fd, VIDIOC_G_PARM, &parameters); error != 0) {
    // Not every device has rates: that is worth a word where one was asked for.
    if (!IsAbsent(error) || stream->asked_rate_hz > 0.0)
      failures->Add("VIDIOC_G_PARM (frame rate)", error);
    return {};
  }
  const bool can_set = (parameters.parm.capture.capability & V4L2_CAP_TIMEPERFRAME) != 0;
  if (stream->asked_rate_hz > 0.0 && can_set) {
    parameters.parm.capture.timeperframe = {
        1000, static_cast<std::uint32_t>(std::lround(1e3 * stream->asked_rate_hz))};
    if (const int error = system->Ioctl(fd, VIDIOC_S_PARM, &parameters); error != 0)
      return Fail(FromErrno(error, device, "do VIDIOC_S_PARM (frame rate)"));
  }
  stream->frame_rate_hz = Rate(parameters.parm.capture.timeperframe);
  return {};
}

// What ends a list is EINVAL; ENOTTY says that there is none.
bool IsListed(int error, const char* call, CallFailures* failures) {
  if (error != 0 && !IsAbsent(error)) failures->Add(call, error);
  return error == 0;
}

}  // namespace

PixelFormat FormatOf(std::uint32_t fourcc) {
  for (const Fourcc& entry : kFourccs) {
    if (entry.fourcc == fourcc) return entry.format;
  }
  return PixelFormat::kAuto;
}

std::string FourccName(std::uint32_t fourcc) {
  std::string name;
  for (int i = 0; i < 4; ++i) {
    const auto c = static_cast<char>(fourcc >> (8 * i) & 0x7f);
    if (c > ' ') name += c;
  }
  return name;
}

bool StreamFormat::IsOtherRate() const {
  return asked_rate_hz > 0.0 && std::abs(frame_rate_hz - asked_rate_hz) > 0.02 * asked_rate_hz;
}

std::string ToString(const StreamFormat& format) {
  std::string text = FourccName(format.fourcc) + " " + std::to_string(format.raw.width) + " x " +
                     std::to_string(format.raw.height);
  const auto rate = [](double hz) {
    char number[32];
    std::snprintf(number, sizeof number, "%.4g", hz);
    return std::string(number);
  };
  text += format.frame_rate_hz > 0.0 ? ", " + rate(format.frame_rate_hz) + " images/s"
                                     : ", at a rate that the device does not tell";
  if (format.IsOtherRate()) text += " (" + rate(format.asked_rate_hz) + " asked for)";
  return text;
}

std::vector<std::uint32_t> ListFormats(VideoSystem* system, int fd, CallFailures* failures) {
  std::vector<std::uint32_t> formats;
  for (int i = 0; i < kMaxListed; ++i) {
    v4l2_fmtdesc description = {};
    description.index = static_cast<std::uint32_t>(i);
    description.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    const int error = system->Ioctl(fd, VIDIOC_ENUM_FMT, &description);
    if (!IsListed(error, "VIDIOC_ENUM_FMT", failures)) break;
    formats.push_back(description.pixelformat);
  }
  return formats;
}

std::vector<FrameSize> ListSizes(VideoSystem* system, int fd, std::uint32_t fourcc,
                                 CallFailures* failures) {
  std::vector<FrameSize> sizes;
  for (int i = 0; i < kMaxListed; ++i) {
    v4l2_frmsizeenum entry = {};
    entry.index = static_cast<std::uint32_t>(i);
    entry.pixel_format = fourcc;
    const int error = system->Ioctl(fd, VIDIOC_ENUM_FRAMESIZES, &entry);
    if (!IsListed(error, "VIDIOC_ENUM_FRAMESIZES", failures)) break;
    const bool is_range = entry.type != V4L2_FRMSIZE_TYPE_DISCRETE;
    sizes.push_back({static_cast<int>(is_range ? entry.stepwise.max_width : entry.discrete.width),
                     static_cast<int>(is_range ? entry.stepwise.max_height : entry.discrete.height),
                     is_range});
    if (is_range) break;
  }
  return sizes;
}

double MaxRate(VideoSystem* system, int fd, std::uint32_t fourcc, int width, int height,
               CallFailures* failures) {
  double best = 0.0;
  for (int i = 0; i < kMaxListed; ++i) {
    v4l2_frmivalenum entry = {};
    entry.index = static_cast<std::uint32_t>(i);
    entry.pixel_format = fourcc;
    entry.width = static_cast<std::uint32_t>(width);
    entry.height = static_cast<std::uint32_t>(height);
    const int error = system->Ioctl(fd, VIDIOC_ENUM_FRAMEINTERVALS, &entry);
    if (!IsListed(error, "VIDIOC_ENUM_FRAMEINTERVALS", failures)) break;
    const bool is_range = entry.type != V4L2_FRMIVAL_TYPE_DISCRETE;
    best = std::max(best, Rate(is_range ? entry.stepwise.min : entry.discrete));
    if (is_range) break;
  }
  return best;
}

IoExpected<StreamFormat> ChooseFormat(VideoSystem* system, int fd, const CaptureOptions& options,
                                      int width, int height, const std::string& device,
                                      CallFailures* failures) {
  const std::vector<std::uint32_t> offered = ListFormats(system, fd, failures);
  std::uint32_t chosen = 0;
  double chosen_rate = -1.0;
  int last_error = 0;
  std::optional<v4l2_format> interlaced;
  for (const std::uint32_t fourcc : Candidates(offered, options.format)) {
    v4l2_format format = MakeFormat(fourcc, width, height);
    const int error = system->Ioctl(fd, VIDIOC_TRY_FMT, &format);
    if (error != 0 && error != EINVAL) last_error = error;
    if (error != 0 || !Is(format, fourcc, width, height)) continue;
    if (IsInterlaced(format)) {
      interlaced = format;
      continue;
    }
    const double rate = MaxRate(system, fd, fourcc, width, height, failures);
    // The first serves, unless it is too slow and a later one is not.
    const bool is_fast = rate <= 0.0 || rate >= kRateSlack * options.frame_rate_hz;
    if (chosen == 0 || (is_fast && chosen_rate >= 0.0)) chosen = fourcc;
    chosen_rate = is_fast ? -1.0 : rate;
    if (is_fast) break;
  }
  if (chosen == 0) {
    if (last_error != 0) return Fail(FromErrno(last_error, device, "do VIDIOC_TRY_FMT"));
    if (interlaced) return Fail(Interlaced(device, *interlaced));
    return Fail({Errc::kUnsupported, device, "capture.format",
                 "has no " + std::string(ToString(options.format)) + " image of " +
                     std::to_string(width) + " x " + std::to_string(height) + " px; it offers " +
                     Offer(system, fd, offered, failures),
                 "give the camera's size in rig.yaml's camera, and a format it has"});
  }
  v4l2_format format = MakeFormat(chosen, width, height);
  if (const int error = system->Ioctl(fd, VIDIOC_S_FMT, &format); error != 0)
    return Fail(FromErrno(error, device, "do VIDIOC_S_FMT"));
  if (!Is(format, chosen, width, height)) {
    return Fail({Errc::kIo, device, "VIDIOC_S_FMT",
                 "granted another format than VIDIOC_TRY_FMT promised", "see what else uses it"});
  }
  if (IsInterlaced(format)) return Fail(Interlaced(device, format));
  StreamFormat stream;
  stream.fourcc = chosen;
  stream.raw = {FormatOf(chosen), width, height, static_cast<int>(format.fmt.pix.bytesperline)};
  stream.image_bytes = format.fmt.pix.sizeimage;
  stream.asked_rate_hz = options.frame_rate_hz;
  if (auto s = SetRate(system, fd, device, failures, &stream); !s) return Fail(s.error());
  return stream;
}

}  // namespace rsfm

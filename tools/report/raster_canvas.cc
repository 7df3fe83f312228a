#include <cctype>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "tools/report/canvas.h"

namespace rsfm {
namespace {

constexpr double kScale = 2.0;        // of the drawing to the result
constexpr int kShift = 4;             // OpenCV's fixed-point fraction of coordinates
constexpr double kHersheyCap = 21.0;  // cap height of the stroke font at scale 1, px
constexpr double kCapShare = 0.70;    // of a font's size

cv::Scalar Bgr(const Colour& colour) { return cv::Scalar(colour.b, colour.g, colour.r); }

// OpenCV's stroke font knows ASCII only.
std::string ToAscii(std::string_view text) {
  static constexpr std::pair<std::string_view, std::string_view> kWords[] = {
      {"\u00b0", "deg"}, {"\u00d7", "x"},   {"\u2013", "-"},  {"\u2014", "-"},
      {"\u00b1", "+/-"}, {"\u00b5", "u"},   {"\u03bc", "u"},  {"\u00b2", "2"},
      {"\u2212", "-"},   {"\u2026", "..."}, {"\u2190", "<-"}, {"\u2192", "->"}};
  std::string result;
  while (!text.empty()) {
    if (static_cast<unsigned char>(text.front()) < 0x80u) {
      result += text.front();
      text.remove_prefix(1);
      continue;
    }
    std::size_t length = 1;
    while (length < text.size() && (static_cast<unsigned char>(text[length]) & 0xC0u) == 0x80u) {
      ++length;
    }
    std::string_view word = "?";
    for (const auto& [from, to] : kWords) {
      if (text.substr(0, length) == from) word = to;
    }
    const bool is_unit = word == "deg" && !result.empty() && std::isdigit(result.back()) != 0;
    result += is_unit ? " deg" : word;
    text.remove_prefix(length);
  }
  return result;
}

}  // namespace

struct RasterCanvas::Pixels {
  cv::Mat image;
  cv::Rect clip;
  int width = 0;
  int height = 0;

  cv::Mat View() const { return image(clip); }
  Vec2 InView(const Vec2& point) const { return kScale * point - Vec2(clip.x, clip.y); }
  cv::Point Fixed(const Vec2& point) const {
    const Vec2 p = InView(point) * (1 << kShift);
    const auto limit = [](double v) { return static_cast<int>(std::clamp(v, -1e7, 1e7)); };
    return {limit(std::round(p.x())), limit(std::round(p.y()))};
  }
};

RasterCanvas::RasterCanvas(double width, double height) : pixels_(std::make_unique<Pixels>()) {
  pixels_->width = static_cast<int>(std::lround(width));
  pixels_->height = static_cast<int>(std::lround(height));
  pixels_->image = cv::Mat(static_cast<int>(kScale) * pixels_->height,
                           static_cast<int>(kScale) * pixels_->width, CV_8UC3, Bgr(kPaper));
  SetClip(nullptr);
}

RasterCanvas::~RasterCanvas() = default;

void RasterCanvas::SetClip(const Box* box) {
  const cv::Rect all(0, 0, pixels_->image.cols, pixels_->image.rows);
  pixels_->clip = all;
  if (box == nullptr) return;
  const Vec2 min = kScale * box->min;
  const Vec2 size = kScale * (box->max - box->min);
  pixels_->clip &= cv::Rect(static_cast<int>(min.x()), static_cast<int>(min.y()),
                            static_cast<int>(std::ceil(size.x())) + 1,
                            static_cast<int>(std::ceil(size.y())) + 1);
}

void RasterCanvas::Line(std::span<const Vec2> points, const Stroke& stroke) {
  cv::Mat view = pixels_->View();
  const int thickness = std::max(1, static_cast<int>(std::lround(kScale * stroke.width)));
  const auto segment = [&](const Vec2& a, const Vec2& b) {
    cv::line(view, pixels_->Fixed(a), pixels_->Fixed(b), Bgr(stroke.colour), thickness, cv::LINE_AA,
             kShift);
  };
  constexpr double kDash = 6.0;
  constexpr double kPeriod = 10.0;
  double walked = 0.0;
  for (std::size_t i = 0; i + 1 < points.size(); ++i) {
    if (!stroke.dashed) {
      segment(points[i], points[i + 1]);
      continue;
    }
    const Vec2 step = points[i + 1] - points[i];
    const double length = step.norm();
    for (double s = -std::fmod(walked, kPeriod); s < length; s += kPeriod) {
      const double from = std::max(s, 0.0);
      const double to = std::min(s + kDash, length);
      if (to > from) segment(points[i] + step * (from / length), points[i] + step * (to / length));
    }
    walked += length;
  }
}

void RasterCanvas::Fill(const Box& box, const Colour& colour) {
  cv::Mat view = pixels_->View();
  const Vec2 min = pixels_->InView(box.min);
  const Vec2 max = pixels_->InView(box.max);
  const cv::Rect rect(
      cv::Point(static_cast<int>(std::lround(min.x())), static_cast<int>(std::lround(min.y()))),
      cv::Point(static_cast<int>(std::lround(max.x())), static_cast<int>(std::lround(max.y()))));
  view(rect & cv::Rect(0, 0, view.cols, view.rows)).setTo(Bgr(colour));
}

void RasterCanvas::Dots(std::span<const Vec2> centers, std::span<const Colour> colours,
                        double radius) {
  cv::Mat view = pixels_->View();
  const int fixed_radius = static_cast<int>(std::lround(kScale * radius * (1 << kShift)));
  for (std::size_t i = 0; i < centers.size(); ++i) {
    cv::circle(view, pixels_->Fixed(centers[i]), fixed_radius,
               Bgr(colours[colours.size() == 1 ? 0 : i]), cv::FILLED, cv::LINE_AA, kShift);
  }
}

void RasterCanvas::Text(const Vec2& at, std::string_view text, const TextStyle& style) {
  const std::string ascii = ToAscii(text);
  const double scale = kScale * style.size * kCapShare / kHersheyCap;
  const int thickness = style.size >= 15.0 ? 3 : 2;
  int base_line = 0;
  const cv::Size size =
      cv::getTextSize(ascii, cv::FONT_HERSHEY_SIMPLEX, scale, thickness, &base_line);
  const double share = 0.5 * static_cast<double>(style.anchor);
  cv::Mat view = pixels_->View();
  const Vec2 p = pixels_->InView(at);
  const auto shift = static_cast<int>(std::lround(share * size.width));
  const cv::Point place(static_cast<int>(std::lround(p.x())), static_cast<int>(std::lround(p.y())));
  if (!style.vertical) {
    cv::putText(view, ascii, place - cv::Point(shift, 0), cv::FONT_HERSHEY_SIMPLEX, scale,
                Bgr(style.colour), thickness, cv::LINE_AA);
    return;
  }
  // Drawn level, turned, and laid over what is there by taking the darker.
  const int margin = 4;
  cv::Mat level(size.height + base_line + 2 * margin, size.width + 2 * margin, CV_8UC3,
                Bgr(kPaper));
  cv::putText(level, ascii, {margin, margin + size.height}, cv::FONT_HERSHEY_SIMPLEX, scale,
              Bgr(style.colour), thickness, cv::LINE_AA);
  cv::Mat turned;
  cv::rotate(level, turned, cv::ROTATE_90_COUNTERCLOCKWISE);
  const cv::Rect target(place.x - margin - size.height, place.y - turned.rows + margin + shift,
                        turned.cols, turned.rows);
  const cv::Rect visible = target & cv::Rect(0, 0, view.cols, view.rows);
  if (visible.empty()) return;
  cv::Mat under = view(visible);
  cv::min(under, turned(visible - target.tl()), under);
}

IoExpected<std::string> RasterCanvas::Finish() const {
  cv::Mat small;
  cv::resize(pixels_->image, small, cv::Size(pixels_->width, pixels_->height), 0.0, 0.0,
             cv::INTER_AREA);
  std::vector<unsigned char> bytes;
  if (!cv::imencode(".png", small, bytes, {cv::IMWRITE_PNG_COMPRESSION, 9})) {
    return Fail({Errc::kIo, "", "PNG", "cannot be encoded", ""});
  }
  return std::string(bytes.begin(), bytes.end());
}

}  // namespace rsfm

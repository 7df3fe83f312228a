#include <algorithm>
#include <cstdio>
#include <map>

#include "tools/report/canvas.h"

namespace rsfm {
namespace {

// A hundredth of a pixel, without trailing zeros.
std::string Number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.2f", value);
  std::string result = text;
  while (result.back() == '0') result.pop_back();
  if (result.back() == '.') result.pop_back();
  return result == "-0" ? "0" : result;
}

std::string Hex(const Colour& colour) {
  char text[8];
  std::snprintf(text, sizeof text, "#%02x%02x%02x", colour.r, colour.g, colour.b);
  return text;
}

std::string Escape(std::string_view text) {
  std::string result;
  for (const char c : text) {
    if (c == '&') {
      result += "&amp;";
    } else if (c == '<') {
      result += "&lt;";
    } else if (c == '>') {
      result += "&gt;";
    } else {
      result += c;
    }
  }
  return result;
}

}  // namespace

double Canvas::TextWidth(std::string_view text, double size) {
  const auto is_start = [](char c) { return (static_cast<unsigned char>(c) & 0xC0u) != 0x80u; };
  return 0.58 * size * static_cast<double>(std::count_if(text.begin(), text.end(), is_start));
}

SvgCanvas::SvgCanvas(double width, double height) : width_(width), height_(height) {}

void SvgCanvas::Line(std::span<const Vec2> points, const Stroke& stroke) {
  if (points.size() < 2) return;
  body_ += "<polyline fill=\"none\" stroke=\"" + Hex(stroke.colour) + "\" stroke-width=\"" +
           Number(stroke.width) + "\" stroke-linejoin=\"round\"";
  if (stroke.dashed) body_ += " stroke-dasharray=\"6 4\"";
  body_ += " points=\"";
  for (const Vec2& point : points) body_ += Number(point.x()) + "," + Number(point.y()) + " ";
  body_ += "\"/>\n";
}

void SvgCanvas::Fill(const Box& box, const Colour& colour) {
  const Vec2 size = box.max - box.min;
  body_ += "<rect x=\"" + Number(box.min.x()) + "\" y=\"" + Number(box.min.y()) + "\" width=\"" +
           Number(size.x()) + "\" height=\"" + Number(size.y()) + "\" fill=\"" + Hex(colour) +
           "\"/>\n";
}

// One path per colour, each dot a line of no length with round ends: about 12 bytes a dot.
void SvgCanvas::Dots(std::span<const Vec2> centers, std::span<const Colour> colours,
                     double radius) {
  std::map<std::string, std::string> paths;
  for (std::size_t i = 0; i < centers.size(); ++i) {
    const Colour& colour = colours[colours.size() == 1 ? 0 : i];
    paths[Hex(colour)] += "M" + Number(centers[i].x()) + " " + Number(centers[i].y()) + "h0";
  }
  for (const auto& [colour, path] : paths) {
    body_ += "<path stroke=\"" + colour + "\" stroke-width=\"" + Number(2.0 * radius) +
             "\" stroke-linecap=\"round\" d=\"" + path + "\"/>\n";
  }
}

void SvgCanvas::Text(const Vec2& at, std::string_view text, const TextStyle& style) {
  static constexpr const char* kAnchors[] = {"start", "middle", "end"};
  body_ += "<text font-size=\"" + Number(style.size) + "\" fill=\"" + Hex(style.colour) +
           "\" text-anchor=\"" + kAnchors[static_cast<int>(style.anchor)] + "\"";
  const std::string place = Number(at.x()) + " " + Number(at.y());
  if (style.vertical) {
    body_ += " transform=\"translate(" + place + ") rotate(-90)\">";
  } else {
    body_ += " transform=\"translate(" + place + ")\">";
  }
  body_ += Escape(text) + "</text>\n";
}

void SvgCanvas::SetClip(const Box* box) {
  if (is_clipped_) body_ += "</g>\n";
  is_clipped_ = box != nullptr;
  if (box == nullptr) return;
  // Several figures may stand in one HTML page: the name carries the box, so that equal names clip
  // alike.
  const Vec2 size = box->max - box->min;
  const std::string rect = "x=\"" + Number(box->min.x()) + "\" y=\"" + Number(box->min.y()) +
                           "\" width=\"" + Number(size.x()) + "\" height=\"" + Number(size.y()) +
                           "\"";
  std::string id = "clip";
  for (const double value : {box->min.x(), box->min.y(), size.x(), size.y()}) {
    id += "-" + Number(value);
  }
  std::replace(id.begin(), id.end(), '.', '_');
  clips_ += "<clipPath id=\"" + id + "\"><rect " + rect + "/></clipPath>\n";
  body_ += "<g clip-path=\"url(#" + id + ")\">\n";
}

std::string SvgCanvas::Finish() const {
  const std::string size = Number(width_) + " " + Number(height_);
  std::string result = "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 " + size +
                       "\" width=\"" + Number(width_) + "\" height=\"" + Number(height_) +
                       "\" font-family=\"Helvetica, Arial, sans-serif\">\n";
  if (!clips_.empty()) result += "<defs>\n" + clips_ + "</defs>\n";
  result += "<rect width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>\n" + body_;
  if (is_clipped_) result += "</g>\n";
  return result + "</svg>\n";
}

}  // namespace rsfm

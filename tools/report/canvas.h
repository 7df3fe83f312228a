// Drawing surfaces for figures: one for SVG text, one for pixels. Units are pixels of the figure,
// x right and y down from its top-left corner.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "rsfm/base/linear.h"
#include "rsfm/io/diagnostic.h"

namespace rsfm {

struct Colour {
  std::uint8_t r = 0, g = 0, b = 0;
  bool operator==(const Colour&) const = default;
};

inline constexpr Colour kInk{34, 34, 34};
inline constexpr Colour kPaper{255, 255, 255};

struct Stroke {
  Colour colour = kInk;
  double width = 1.0;
  bool dashed = false;
};

struct TextStyle {
  enum class Anchor { kStart, kMiddle, kEnd };

  double size = 13.0;
  Anchor anchor = Anchor::kStart;
  Colour colour = kInk;
  bool vertical = false;  // turned to read upwards, about its anchor
};

struct Box {
  Vec2 min = Vec2::Zero();
  Vec2 max = Vec2::Zero();
};

class Canvas {
 public:
  virtual ~Canvas() = default;

  virtual void Line(std::span<const Vec2> points, const Stroke& stroke) = 0;
  virtual void Fill(const Box& box, const Colour& colour) = 0;
  // Round dots; one colour for each, or one for all.
  virtual void Dots(std::span<const Vec2> centers, std::span<const Colour> colours,
                    double radius) = 0;
  // `at` is the anchor on the base line. UTF-8.
  virtual void Text(const Vec2& at, std::string_view text, const TextStyle& style) = 0;
  // Everything until the next call is cut off outside the box; no box: nothing is.
  virtual void SetClip(const Box* box) = 0;

  // The same estimate for every canvas, a little wide, so that layouts agree.
  static double TextWidth(std::string_view text, double size);
};

class SvgCanvas final : public Canvas {
 public:
  SvgCanvas(double width, double height);

  void Line(std::span<const Vec2> points, const Stroke& stroke) override;
  void Fill(const Box& box, const Colour& colour) override;
  void Dots(std::span<const Vec2> centers, std::span<const Colour> colours, double radius) override;
  void Text(const Vec2& at, std::string_view text, const TextStyle& style) override;
  void SetClip(const Box* box) override;

  // A complete document; it may also stand inline in HTML.
  std::string Finish() const;

 private:
  double width_;
  double height_;
  std::string body_;
  std::string clips_;
  bool is_clipped_ = false;
};

// Draws at twice the size and averages down.
class RasterCanvas final : public Canvas {
 public:
  RasterCanvas(double width, double height);
  ~RasterCanvas() override;

  void Line(std::span<const Vec2> points, const Stroke& stroke) override;
  void Fill(const Box& box, const Colour& colour) override;
  void Dots(std::span<const Vec2> centers, std::span<const Colour> colours, double radius) override;
  void Text(const Vec2& at, std::string_view text, const TextStyle& style) override;
  void SetClip(const Box* box) override;

  // Bytes of a PNG file.
  IoExpected<std::string> Finish() const;

 private:
  struct Pixels;
  std::unique_ptr<Pixels> pixels_;
};

}  // namespace rsfm

// One figure: a pair of axes with lines, dots and bars.
#pragma once

#include <string>
#include <vector>

#include "tools/report/canvas.h"

namespace rsfm {

// Colours that most people tell apart.   [Okabe & Ito 2008, "Color Universal Design"]
inline constexpr Colour kOrange{230, 140, 0};
inline constexpr Colour kBlue{0, 100, 178};
inline constexpr Colour kGreen{0, 140, 105};
inline constexpr Colour kRed{200, 60, 20};
inline constexpr Colour kMidGrey{120, 120, 120};

// Dark violet through green to yellow for 0 to 1: equal steps look equal.
Colour Viridis(double fraction);

struct PlotOptions {
  std::string title;
  std::string x_label;  // with its unit in brackets: "east [m]"
  std::string y_label;
  double width = 760.0;  // of the whole figure, px; the most of it with equal_aspect
  double height = 480.0;
  bool equal_aspect =
      false;            // a metre is as long on both axes: maps; the figure then fits the data
  bool y_down = false;  // values grow downwards: depth
  bool y_from_zero = false;
  bool y_log = false;      // of lines and dots; values that are not positive are left out
  bool scale_bar = false;  // a bar of a round length in metres, lower right
};

class Plot {
 public:
  explicit Plot(PlotOptions options) : options_(std::move(options)) {}

  // An empty name keeps a series out of the legend. x and y have the same length; values that are
  // not finite are left out (of a line: they interrupt it).
  void AddLine(std::string name, std::vector<double> x, std::vector<double> y,
               const Stroke& stroke);
  void AddDots(std::string name, std::vector<double> x, std::vector<double> y,
               std::vector<Colour> colours, double radius);
  // Bars between neighbouring edges: edges.size() == heights.size() + 1.
  void AddBars(std::string name, std::vector<double> edges, std::vector<double> heights,
               const Colour& colour);
  // A straight line across the axes at a value of y, or of x.
  void AddLevel(std::string name, double value, bool is_vertical, const Stroke& stroke);
  // A scale of colours to the right: Viridis(0) at the bottom means `low`, Viridis(1) at the top
  // `high`, which may be the smaller number.
  void SetColourBar(std::string label, double low, double high);

  void Draw(Canvas* canvas) const;
  std::string Svg() const;
  IoExpected<std::string> Png() const;

 private:
  enum class Kind { kLine, kDots, kBars, kLevel };
  struct Series {
    Kind kind = Kind::kLine;
    std::string name;
    std::vector<double> x, y;
    std::vector<Colour> colours;
    Stroke stroke;
    double radius = 2.0;
    bool is_vertical = false;
  };
  struct Axes;

  std::vector<double> OnAxis(std::vector<double> y) const;  // decades with y_log
  Axes MakeAxes() const;
  Vec2 FitSize() const;
  void DrawFrame(const Axes& axes, Canvas* canvas) const;
  void DrawDecades(const Axes& axes, Canvas* canvas) const;
  void DrawSeries(const Series& series, const Axes& axes, Canvas* canvas) const;
  void DrawLegend(Canvas* canvas, double left, double right) const;
  void DrawColourBar(const Axes& axes, Canvas* canvas) const;
  void DrawScaleBar(const Axes& axes, Canvas* canvas) const;
  double LegendHeight(double width) const;

  PlotOptions options_;
  std::vector<Series> series_;
  bool has_colour_bar_ = false;
  std::string colour_label_;
  double colour_low_ = 0.0;
  double colour_high_ = 1.0;
};

// Round values in [low, high], about `count` of them: 1, 2 or 5 times a power of ten apart.
std::vector<double> NiceTicks(double low, double high, int count);
// As many decimals as ticks `step` apart need.
std::string FormatTick(double value, double step);

}  // namespace rsfm

#include "tools/report/plot.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>

namespace rsfm {
namespace {

constexpr double kTickSize = 12.0;
constexpr double kLabelSize = 13.0;
constexpr double kTitleSize = 16.0;
constexpr double kLegendRow = 20.0;
constexpr double kLegendGap = 22.0;
constexpr double kLegendMark = 26.0;
constexpr double kMarginLeft = 76.0;
constexpr double kMarginBottom = 52.0;
constexpr double kColourBarMargin = 100.0;
constexpr double kMinAxes = 300.0;  // a figure that fits its data is not made narrower
constexpr Colour kGridColour{228, 228, 228};

struct Range {
  double low = std::numeric_limits<double>::infinity();
  double high = -std::numeric_limits<double>::infinity();

  void Add(double value) {
    if (!std::isfinite(value)) return;
    low = std::min(low, value);
    high = std::max(high, value);
  }
  void Pad(double share) {
    if (low > high) *this = {0.0, 1.0};
    double margin = share * (high - low);
    if (high <= low) margin = std::max(1e-3, 0.05 * std::abs(high));
    low -= margin;
    high += margin;
  }
  double size() const { return high - low; }
};

double RoundStep(double rough) {
  const double power = std::pow(10.0, std::floor(std::log10(rough)));
  const double mantissa = rough / power;
  if (mantissa < 1.5) return power;
  if (mantissa < 3.5) return 2.0 * power;
  if (mantissa < 7.5) return 5.0 * power;
  return 10.0 * power;
}

}  // namespace

Colour Viridis(double fraction) {
  // Nine of its colours, linear in between.   [Smith & van der Walt 2015, matplotlib]
  static constexpr std::array<Colour, 9> kStops = {{{68, 1, 84},
                                                    {71, 44, 122},
                                                    {59, 81, 139},
                                                    {44, 113, 142},
                                                    {33, 144, 141},
                                                    {39, 173, 129},
                                                    {92, 200, 99},
                                                    {170, 220, 50},
                                                    {253, 231, 37}}};
  const double position = std::clamp(fraction, 0.0, 1.0) * (kStops.size() - 1);
  const auto i = std::min(static_cast<std::size_t>(position), kStops.size() - 2);
  const double t = position - static_cast<double>(i);
  const auto mix = [&](std::uint8_t a, std::uint8_t b) {
    return static_cast<std::uint8_t>(std::lround(a + t * (b - a)));
  };
  const Colour& low = kStops[i];
  const Colour& high = kStops[i + 1];
  return {mix(low.r, high.r), mix(low.g, high.g), mix(low.b, high.b)};
}

std::vector<double> NiceTicks(double low, double high, int count) {
  const double step = RoundStep((high - low) / std::max(1, count));
  std::vector<double> ticks;
  for (double i = std::ceil(low / step - 1e-9); i * step <= high + 1e-9 * step; i += 1.0) {
    ticks.push_back(i * step);
  }
  return ticks;
}

std::string FormatTick(double value, double step) {
  const int decimals = std::clamp(static_cast<int>(std::ceil(-std::log10(step) - 1e-9)), 0, 9);
  const double shown = std::abs(value) < 1e-6 * step ? 0.0 : value;  // no "-0.0"
  char text[48];
  std::snprintf(text, sizeof text, "%.*f", decimals, shown);
  return text;
}

namespace {

// Ten to the power of `decade`: "0.01", and "1e-5" beyond what fits beside an axis.
std::string FormatPower(int decade) {
  if (decade < -3 || decade > 4) return "1e" + std::to_string(decade);
  const double power = std::pow(10.0, decade);
  return FormatTick(power, power);
}

}  // namespace

struct Plot::Axes {
  Box box;  // px
  Range x, y;
  bool y_down = false;
  Vec2 size = Vec2::Zero();  // of the whole figure, px

  double X(double value) const {
    return box.min.x() + (value - x.low) / x.size() * (box.max.x() - box.min.x());
  }
  double Y(double value) const {
    const double up = (value - y.low) / y.size() * (box.max.y() - box.min.y());
    return y_down ? box.min.y() + up : box.max.y() - up;
  }
  Vec2 At(double vx, double vy) const { return {X(vx), Y(vy)}; }
};

std::vector<double> Plot::OnAxis(std::vector<double> y) const {
  if (!options_.y_log) return y;
  for (double& value : y)
    value = value > 0.0 ? std::log10(value) : std::numeric_limits<double>::quiet_NaN();
  return y;
}

void Plot::AddLine(std::string name, std::vector<double> x, std::vector<double> y,
                   const Stroke& stroke) {
  series_.push_back({Kind::kLine, std::move(name), std::move(x), OnAxis(std::move(y)), {}, stroke});
}

void Plot::AddDots(std::string name, std::vector<double> x, std::vector<double> y,
                   std::vector<Colour> colours, double radius) {
  series_.push_back({Kind::kDots,
                     std::move(name),
                     std::move(x),
                     OnAxis(std::move(y)),
                     std::move(colours),
                     {},
                     radius});
}

void Plot::AddBars(std::string name, std::vector<double> edges, std::vector<double> heights,
                   const Colour& colour) {
  series_.push_back({Kind::kBars,
                     std::move(name),
                     std::move(edges),
                     std::move(heights),
                     {colour},
                     {colour, 6.0}});
}

void Plot::AddLevel(std::string name, double value, bool is_vertical, const Stroke& stroke) {
  series_.push_back(
      {Kind::kLevel, std::move(name), {value}, {value}, {}, stroke, 0.0, is_vertical});
}

void Plot::SetColourBar(std::string label, double low, double high) {
  has_colour_bar_ = true;
  colour_label_ = std::move(label);
  colour_low_ = low;
  colour_high_ = high;
}

double Plot::LegendHeight(double width) const {
  double x = 0.0;
  int rows = 0;
  for (const Series& series : series_) {
    if (series.name.empty()) continue;
    const double need = kLegendMark + Canvas::TextWidth(series.name, kTickSize) + kLegendGap;
    if (rows == 0 || x + need > width) {
      ++rows;
      x = 0.0;
    }
    x += need;
  }
  return rows * kLegendRow;
}

Plot::Axes Plot::MakeAxes() const {
  Axes axes;
  axes.y_down = options_.y_down;
  for (const Series& series : series_) {
    if (series.kind == Kind::kLevel) {
      (series.is_vertical ? axes.x : axes.y).Add(series.x[0]);
      continue;
    }
    for (const double value : series.x) axes.x.Add(value);
    for (const double value : series.y) axes.y.Add(value);
    if (series.kind == Kind::kBars) axes.y.Add(0.0);
  }
  const bool from_zero = options_.y_from_zero && axes.y.low >= 0.0;
  const bool is_histogram = std::any_of(series_.begin(), series_.end(), [](const Series& series) {
    return series.kind == Kind::kBars;
  });
  axes.x.Pad(is_histogram ? 0.0 : 0.03);  // bars begin at the axis
  axes.y.Pad(0.06);
  if (from_zero) axes.y.low = 0.0;
  const double right = has_colour_bar_ ? kColourBarMargin : 22.0;
  Vec2 inner(options_.width - kMarginLeft - right, 0.0);
  inner.y() = options_.height - kMarginBottom - 38.0 - LegendHeight(inner.x());
  if (options_.equal_aspect) {
    const double metres_per_px = std::max(axes.x.size() / inner.x(), axes.y.size() / inner.y());
    const Vec2 need = Vec2(axes.x.size(), axes.y.size()) / metres_per_px;
    inner = inner.cwiseMin(need.cwiseMax(kMinAxes));
  }
  const Vec2 corner(kMarginLeft, 38.0 + LegendHeight(inner.x()));
  axes.box = {corner, corner + inner};
  axes.size = axes.box.max + Vec2(right, kMarginBottom);
  if (options_.equal_aspect) {
    const Vec2 size = axes.box.max - axes.box.min;
    const double metres_per_px = std::max(axes.x.size() / size.x(), axes.y.size() / size.y());
    const auto widen = [&](Range* range, double pixels) {
      const double extra = 0.5 * (metres_per_px * pixels - range->size());
      range->low -= extra;
      range->high += extra;
    };
    widen(&axes.x, size.x());
    widen(&axes.y, size.y());
  }
  return axes;
}

void Plot::DrawFrame(const Axes& axes, Canvas* canvas) const {
  const Box& box = axes.box;
  const auto line = [&](const Vec2& a, const Vec2& b, const Stroke& stroke) {
    const Vec2 ends[2] = {a, b};
    canvas->Line(ends, stroke);
  };
  const double width = box.max.x() - box.min.x();
  const double height = box.max.y() - box.min.y();
  const std::vector<double> xs =
      NiceTicks(axes.x.low, axes.x.high, std::max(2, static_cast<int>(width / 90.0)));
  const std::vector<double> ys =
      NiceTicks(axes.y.low, axes.y.high, std::max(2, static_cast<int>(height / 60.0)));
  const double x_step = xs.size() > 1 ? xs[1] - xs[0] : 1.0;
  const double y_step = ys.size() > 1 ? ys[1] - ys[0] : 1.0;
  for (const double value : xs) {
    line({axes.X(value), box.min.y()}, {axes.X(value), box.max.y()}, {kGridColour, 1.0});
    canvas->Text({axes.X(value), box.max.y() + 17.0}, FormatTick(value, x_step),
                 {kTickSize, TextStyle::Anchor::kMiddle});
  }
  double widest = 0.0;
  if (options_.y_log) {
    DrawDecades(axes, canvas);
    widest = Canvas::TextWidth("0.001", kTickSize);
  }
  for (const double value : options_.y_log ? std::vector<double>() : ys) {
    line({box.min.x(), axes.Y(value)}, {box.max.x(), axes.Y(value)}, {kGridColour, 1.0});
    const std::string text = FormatTick(value, y_step);
    widest = std::max(widest, Canvas::TextWidth(text, kTickSize));
    canvas->Text({box.min.x() - 7.0, axes.Y(value) + 4.0}, text,
                 {kTickSize, TextStyle::Anchor::kEnd});
  }
  canvas->Text({0.5 * (box.min.x() + box.max.x()), box.max.y() + 39.0}, options_.x_label,
               {kLabelSize, TextStyle::Anchor::kMiddle});
  canvas->Text({std::max(16.0, box.min.x() - 18.0 - widest), 0.5 * (box.min.y() + box.max.y())},
               options_.y_label, {kLabelSize, TextStyle::Anchor::kMiddle, kInk, true});
  canvas->Text({box.min.x(), 24.0}, options_.title, {kTitleSize});
}

// A line at 1 to 9 times each power of ten, the powers by name.
void Plot::DrawDecades(const Axes& axes, Canvas* canvas) const {
  const Box& box = axes.box;
  for (int decade = static_cast<int>(std::floor(axes.y.low)); decade <= axes.y.high; ++decade) {
    for (int digit = 1; digit < 10; ++digit) {
      const double value = decade + std::log10(digit);
      if (value < axes.y.low || value > axes.y.high) continue;
      const Vec2 ends[2] = {{box.min.x(), axes.Y(value)}, {box.max.x(), axes.Y(value)}};
      canvas->Line(ends, {kGridColour, digit == 1 ? 1.4 : 0.5});
      if (digit != 1) continue;
      canvas->Text({box.min.x() - 7.0, axes.Y(value) + 4.0}, FormatPower(decade),
                   {kTickSize, TextStyle::Anchor::kEnd});
    }
  }
}

void Plot::DrawSeries(const Series& series, const Axes& axes, Canvas* canvas) const {
  if (series.kind == Kind::kLevel) {
    const double value = series.x[0];
    const Vec2 ends[2] = {series.is_vertical ? Vec2(axes.X(value), axes.box.min.y())
                                             : Vec2(axes.box.min.x(), axes.Y(value)),
                          series.is_vertical ? Vec2(axes.X(value), axes.box.max.y())
                                             : Vec2(axes.box.max.x(), axes.Y(value))};
    canvas->Line(ends, series.stroke);
    return;
  }
  if (series.kind == Kind::kBars) {
    for (std::size_t i = 0; i < series.y.size(); ++i) {
      const double gap = axes.X(series.x[i + 1]) - axes.X(series.x[i]) > 4.0 ? 0.5 : 0.0;
      Box bar = {axes.At(series.x[i], series.y[i]), axes.At(series.x[i + 1], 0.0)};
      bar.min.x() += gap;
      bar.max.x() -= gap;
      if (series.y[i] > 0.0) canvas->Fill(bar, series.colours[0]);
    }
    return;
  }
  std::vector<Vec2> points;
  std::vector<Colour> colours;
  for (std::size_t i = 0; i < series.x.size(); ++i) {
    if (std::isfinite(series.x[i]) && std::isfinite(series.y[i])) {
      points.push_back(axes.At(series.x[i], series.y[i]));
      if (series.colours.size() > 1) colours.push_back(series.colours[i]);
    } else if (series.kind == Kind::kLine) {
      canvas->Line(points, series.stroke);
      points.clear();
    }
  }
  if (series.kind == Kind::kLine) {
    canvas->Line(points, series.stroke);
  } else {
    canvas->Dots(points, colours.empty() ? series.colours : colours, series.radius);
  }
}

void Plot::DrawLegend(Canvas* canvas, double left, double right) const {
  double x = left;
  double y = 44.0;
  for (const Series& series : series_) {
    if (series.name.empty()) continue;
    const double need = kLegendMark + Canvas::TextWidth(series.name, kTickSize) + kLegendGap;
    if (x > left && x + need > right + kLegendGap) {
      x = left;
      y += kLegendRow;
    }
    const Vec2 middle(x + 9.0, y - 4.0);
    if (series.kind == Kind::kDots) {
      canvas->Dots({&middle, 1}, {series.colours.data(), 1}, std::max(3.0, series.radius));
    } else if (series.kind == Kind::kBars) {
      canvas->Fill({middle - Vec2(6.0, 5.0), middle + Vec2(6.0, 5.0)}, series.colours[0]);
    } else {
      const Vec2 ends[2] = {middle - Vec2(9.0, 0.0), middle + Vec2(9.0, 0.0)};
      canvas->Line(ends, series.stroke);
    }
    canvas->Text({x + kLegendMark, y}, series.name, {kTickSize});
    x += need;
  }
}

void Plot::DrawColourBar(const Axes& axes, Canvas* canvas) const {
  constexpr int kSteps = 64;
  const double left = axes.box.max.x() + 14.0;
  const double top = axes.box.min.y();
  const double height = axes.box.max.y() - top;
  for (int i = 0; i < kSteps; ++i) {
    const double y = top + height * i / kSteps;
    canvas->Fill({Vec2(left, y), Vec2(left + 14.0, y + height / kSteps + 0.6)},
                 Viridis(1.0 - (i + 0.5) / kSteps));
  }
  const std::vector<double> ticks =
      NiceTicks(std::min(colour_low_, colour_high_), std::max(colour_low_, colour_high_),
                static_cast<int>(height / 70.0) + 1);
  const double step = ticks.size() > 1 ? ticks[1] - ticks[0] : 1.0;
  for (const double value : ticks) {
    const double fraction = (value - colour_low_) / (colour_high_ - colour_low_);
    const double y = top + height * (1.0 - fraction);
    canvas->Text({left + 19.0, y + 4.0}, FormatTick(value, step), {kTickSize});
  }
  canvas->Text({left + 76.0, top + 0.5 * height}, colour_label_,
               {kTickSize, TextStyle::Anchor::kMiddle, kInk, true});
}

void Plot::DrawScaleBar(const Axes& axes, Canvas* canvas) const {
  const double px_per_metre = (axes.box.max.x() - axes.box.min.x()) / axes.x.size();
  const double metres = RoundStep(0.18 * axes.x.size());
  const Vec2 right = axes.box.max - Vec2(16.0, 16.0);
  const Vec2 left = right - Vec2(metres * px_per_metre, 0.0);
  const std::string text = FormatTick(metres, metres) + " m";
  const double half = 0.5 * std::max(right.x() - left.x(), Canvas::TextWidth(text, kTickSize));
  const Vec2 middle = 0.5 * (left + right);
  canvas->Fill({middle - Vec2(half + 8.0, 22.0), middle + Vec2(half + 8.0, 9.0)}, kPaper);
  const Vec2 ends[2] = {left, right};
  canvas->Line(ends, {kInk, 3.0});
  canvas->Text(middle - Vec2(0.0, 7.0), text, {kTickSize, TextStyle::Anchor::kMiddle});
}

void Plot::Draw(Canvas* canvas) const {
  const Axes axes = MakeAxes();
  DrawFrame(axes, canvas);
  canvas->SetClip(&axes.box);
  for (const Series& series : series_) DrawSeries(series, axes, canvas);
  canvas->SetClip(nullptr);
  const Vec2& min = axes.box.min;
  const Vec2& max = axes.box.max;
  const Vec2 border[5] = {min, {max.x(), min.y()}, max, {min.x(), max.y()}, min};
  canvas->Line(border, {kMidGrey, 1.0});
  DrawLegend(canvas, min.x(), max.x());
  if (has_colour_bar_) DrawColourBar(axes, canvas);
  if (options_.scale_bar) DrawScaleBar(axes, canvas);
}

Vec2 Plot::FitSize() const { return MakeAxes().size; }

std::string Plot::Svg() const {
  const Vec2 size = FitSize();
  SvgCanvas canvas(size.x(), size.y());
  Draw(&canvas);
  return canvas.Finish();
}

IoExpected<std::string> Plot::Png() const {
  const Vec2 size = FitSize();
  RasterCanvas canvas(size.x(), size.y());
  Draw(&canvas);
  return canvas.Finish();
}

}  // namespace rsfm

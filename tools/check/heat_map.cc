#include "tools/check/heat_map.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "tools/report/plot.h"

namespace rsfm {
namespace {

constexpr double kImageWidth = 640.0;
constexpr double kLeft = 62.0, kTop = 84.0, kRight = 110.0, kBottom = 52.0;
constexpr Colour kBlind{225, 225, 225};  // where the camera sees nothing
constexpr double kSmall = 12.0;

std::string Print(const char* format, double a, double b) {
  char text[160];
  std::snprintf(text, sizeof text, format, a, b);
  return text;
}

// The image's place in the figure.
Box ImageBox(const AnyCamera& camera) {
  const double height = std::clamp(kImageWidth * camera.height() / camera.width(), 60.0, 900.0);
  return {Vec2(kLeft, kTop), Vec2(kLeft + kImageWidth, kTop + height)};
}

void DrawAxes(const AnyCamera& camera, const Box& box, Canvas* canvas) {
  const Vec2 corners[] = {
      box.min, {box.max.x(), box.min.y()}, box.max, {box.min.x(), box.max.y()}, box.min};
  canvas->Line(corners, {});
  const std::vector<double> columns = NiceTicks(0.0, camera.width(), 6);
  for (const double u : columns) {
    const double x = box.min.x() + (box.max.x() - box.min.x()) * u / camera.width();
    canvas->Text({x, box.max.y() + 17.0}, FormatTick(u, 1.0), {kSmall, TextStyle::Anchor::kMiddle});
  }
  for (const double v : NiceTicks(0.0, camera.height(), 5)) {
    const double y = box.min.y() + (box.max.y() - box.min.y()) * v / camera.height();
    canvas->Text({box.min.x() - 6.0, y + 4.0}, FormatTick(v, 1.0),
                 {kSmall, TextStyle::Anchor::kEnd});
  }
  canvas->Text({0.5 * (box.min.x() + box.max.x()), box.max.y() + 38.0}, "image column [px]",
               {kSmall, TextStyle::Anchor::kMiddle});
  canvas->Text({16.0, 0.5 * (box.min.y() + box.max.y())}, "image row [px]",
               {kSmall, TextStyle::Anchor::kMiddle, kInk, true});
}

void DrawScale(const Box& box, double top_px, Canvas* canvas) {
  constexpr int kSteps = 64;
  const double left = box.max.x() + 18.0, height = box.max.y() - box.min.y();
  for (int i = 0; i < kSteps; ++i) {
    const double y = box.min.y() + height * i / kSteps;
    canvas->Fill({Vec2(left, y), Vec2(left + 16.0, y + height / kSteps + 0.6)},
                 Viridis(1.0 - (i + 0.5) / kSteps));
  }
  const std::vector<double> ticks = NiceTicks(0.0, top_px, 6);
  const double step = ticks.size() > 1 ? ticks[1] - ticks[0] : 1.0;
  for (const double value : ticks) {
    canvas->Text({left + 21.0, box.max.y() - height * value / top_px + 4.0},
                 FormatTick(value, step), {kSmall});
  }
  canvas->Text({left + 78.0, 0.5 * (box.min.y() + box.max.y())}, "largest error in the band [px]",
               {kSmall, TextStyle::Anchor::kMiddle, kInk, true});
}

}  // namespace

Vec2 HeatMapSize(const AnyCamera& camera) { return ImageBox(camera).max + Vec2(kRight, kBottom); }

void DrawHeatMap(const AnyCamera& camera, const RefractionEffect& effect, const std::string& title,
                 const std::string& verdict, Canvas* canvas) {
  canvas->Fill({Vec2::Zero(), HeatMapSize(camera)}, kPaper);
  canvas->Text({kLeft, 24.0}, title, {16.0});
  canvas->Text({kLeft, 46.0},
               Print("error of the best-fit pinhole from %g to %g m: ", effect.band.near_m,
                     effect.band.far_m) +
                   Print("%.3g px mean, %.3g px at most", effect.mean_px, effect.max_px),
               {13.0});
  canvas->Text({kLeft, 66.0}, verdict, {13.0});
  const Box box = ImageBox(camera);
  const Vec2 cell = (box.max - box.min).cwiseQuotient(Vec2(kEffectColumns, kEffectRows));
  const double top_px = effect.max_px > 0.0 ? effect.max_px : 1.0;
  for (int i = 0; i < kEffectColumns * kEffectRows; ++i) {
    const Vec2 corner = box.min + cell.cwiseProduct(Vec2(i % kEffectColumns, i / kEffectColumns));
    const double error = effect.cell_max_px[static_cast<std::size_t>(i)];
    // A little wider, so that no seam shows; the next cell covers it.
    canvas->Fill({corner, (corner + cell + Vec2(0.6, 0.6)).cwiseMin(box.max)},
                 std::isfinite(error) ? Viridis(error / top_px) : kBlind);
  }
  DrawAxes(camera, box, canvas);
  DrawScale(box, top_px, canvas);
}

}  // namespace rsfm

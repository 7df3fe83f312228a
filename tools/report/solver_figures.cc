#include "tools/report/solver_figures.h"

#include <map>
#include <vector>

#include "tools/report/plot.h"

namespace rsfm {
namespace {

constexpr double kPanelWidth = 520.0, kPanelHeight = 430.0, kCaptionHeight = 30.0;

// Draws beside what is there already.
class ShiftedCanvas final : public Canvas {
 public:
  ShiftedCanvas(Canvas* canvas, const Vec2& shift) : canvas_(canvas), shift_(shift) {}

  void Line(std::span<const Vec2> points, const Stroke& stroke) override {
    canvas_->Line(Shift(points), stroke);
  }
  void Fill(const Box& box, const Colour& colour) override {
    canvas_->Fill({box.min + shift_, box.max + shift_}, colour);
  }
  void Dots(std::span<const Vec2> centers, std::span<const Colour> colours,
            double radius) override {
    canvas_->Dots(Shift(centers), colours, radius);
  }
  void Text(const Vec2& at, std::string_view text, const TextStyle& style) override {
    canvas_->Text(at + shift_, text, style);
  }
  void SetClip(const Box* box) override {
    const Box shifted = box != nullptr ? Box{box->min + shift_, box->max + shift_} : Box();
    canvas_->SetClip(box != nullptr ? &shifted : nullptr);
  }

 private:
  std::vector<Vec2> Shift(std::span<const Vec2> points) const {
    std::vector<Vec2> shifted(points.begin(), points.end());
    for (Vec2& point : shifted) point += shift_;
    return shifted;
  }

  Canvas* canvas_;
  Vec2 shift_;
};

struct MethodStyle {
  const char* label;
  Colour colour;
};
MethodStyle StyleOf(std::string_view method) {
  static const std::map<std::string_view, MethodStyle> styles = {
      {"p3p_in_air", {"P3P, no refraction", kMidGrey}},
      {"gp3p", {"GP3P", kOrange}},
      {"gp3p_refined", {"GP3P refined (ours)", kBlue}},
      {"five_point_in_air", {"5-point, no refraction", kMidGrey}},
      {"best_fit", {"best fit", kOrange}},
      {"best_fit_refined", {"best fit + refinement", kGreen}},
      {"hu17", {"17-point", kRed}},
      {"gr6p", {"GR6P", Colour{150, 90, 170}}},
      {"ours", {"ours", kBlue}},
  };
  return styles.at(method);
}

const char* CaptionOf(SolverPort port) {
  switch (port) {
    case SolverPort::kFlat:
      return "flat port";
    case SolverPort::kDome:
      return "dome port";
    case SolverPort::kCentredDome:
      break;
  }
  return "perfectly centred dome port";
}

using RowMember = double SolverRow::*;
using BoundMember = double SolverBound::*;

Plot MakePanel(const SolverEvaluation& evaluation, const char* title, const char* y_label,
               bool y_log, RowMember of_row, BoundMember of_bound, const char* bound_label) {
  PlotOptions options;
  options.title = title;
  options.x_label = "noise [px]";
  options.y_label = y_label;
  options.width = kPanelWidth;
  options.height = kPanelHeight;
  options.y_log = y_log;
  options.y_from_zero = !y_log;
  Plot plot(options);
  std::vector<std::string_view> methods;
  for (const SolverRow& row : evaluation.rows) {
    if (row.noise_px != evaluation.rows.front().noise_px) break;
    methods.push_back(row.method);
  }
  for (const std::string_view method : methods) {
    std::vector<double> x, y;
    for (const SolverRow& row : evaluation.rows) {
      if (row.method != method) continue;
      x.push_back(row.noise_px);
      y.push_back(row.*of_row);
    }
    const MethodStyle style = StyleOf(method);
    plot.AddLine(style.label, x, y, {style.colour, 2.0});
    plot.AddDots("", x, y, {style.colour}, 3.0);
  }
  std::vector<double> x, y;
  for (const SolverBound& bound : evaluation.bounds) {
    x.push_back(bound.noise_px);
    y.push_back(bound.*of_bound);
  }
  plot.AddLine(bound_label, x, y, {kInk, 1.5, true});
  return plot;
}

}  // namespace

std::string SolverFigureSvg(const SolverEvaluation& evaluation) {
  const bool is_absolute = evaluation.figure == SolverFigure::kAbsolutePose;
  // Relative methods span five decades, absolute ones not one.
  const bool y_log = !is_absolute;
  std::vector<Plot> panels;
  panels.push_back(MakePanel(evaluation, "Rotation", "mean rotation error [deg]", y_log,
                             &SolverRow::rotation_error_deg_mean, &SolverBound::rotation_error_deg,
                             "Cramér–Rao bound"));
  panels.push_back(MakePanel(
      evaluation, is_absolute ? "Position" : "Direction of translation",
      is_absolute ? "mean position error [mm]" : "mean direction error [deg]", y_log,
      &SolverRow::translation_error_mean, &SolverBound::translation_error, "Cramér–Rao bound"));
  if (!is_absolute) {
    panels.push_back(MakePanel(evaluation, "Inliers", "mean inlier ratio", false,
                               &SolverRow::inlier_ratio_mean, &SolverBound::inlier_ratio,
                               "at the true pose"));
  }
  SvgCanvas canvas(kPanelWidth * static_cast<double>(panels.size()), kPanelHeight + kCaptionHeight);
  for (std::size_t i = 0; i < panels.size(); ++i) {
    ShiftedCanvas shifted(&canvas, Vec2(kPanelWidth * static_cast<double>(i), 0.0));
    panels[i].Draw(&shifted);
  }
  const int experiments = evaluation.rows.empty() ? 0 : evaluation.rows.front().experiments;
  canvas.Text({0.5 * kPanelWidth * static_cast<double>(panels.size()),
               kPanelHeight + kCaptionHeight - 12.0},
              std::string(is_absolute ? "Absolute" : "Relative") + " pose, " +
                  CaptionOf(evaluation.port) + ": " + std::to_string(experiments) +
                  " experiments a level, 200 points, 30 % outliers",
              {14.0, TextStyle::Anchor::kMiddle});
  return canvas.Finish();
}

}  // namespace rsfm

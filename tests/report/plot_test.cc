#include "tools/report/plot.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace rsfm {
namespace {

using ::testing::DoubleNear;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;

TEST(NiceTicksTest, AreRoundAndInside) {
  EXPECT_THAT(NiceTicks(0.0, 10.0, 5), ElementsAre(0.0, 2.0, 4.0, 6.0, 8.0, 10.0));
  EXPECT_THAT(NiceTicks(-0.013, 0.031, 4),
              ElementsAre(DoubleNear(-0.01, 1e-12), 0.0, DoubleNear(0.01, 1e-12),
                          DoubleNear(0.02, 1e-12), DoubleNear(0.03, 1e-12)));
  for (const double span : {1e-6, 0.37, 5.0, 812.0, 3e7}) {
    const auto ticks = NiceTicks(1.0, 1.0 + span, 6);
    EXPECT_GE(ticks.size(), 3u) << span;
    EXPECT_LE(ticks.size(), 12u) << span;
  }
}

TEST(FormatTickTest, HasTheDecimalsOfTheStep) {
  EXPECT_EQ(FormatTick(2.0, 2.0), "2");
  EXPECT_EQ(FormatTick(0.25, 0.05), "0.25");
  EXPECT_EQ(FormatTick(-0.0, 1.0), "0");
  EXPECT_EQ(FormatTick(18.4, 0.2), "18.4");
}

TEST(ViridisTest, GoesFromDarkToBrightAndClamps) {
  EXPECT_EQ(Viridis(-1.0), Viridis(0.0));
  EXPECT_EQ(Viridis(2.0), Viridis(1.0));
  int last = -1;
  for (int i = 0; i <= 20; ++i) {
    const Colour c = Viridis(i / 20.0);
    const int luma = 299 * c.r + 587 * c.g + 114 * c.b;
    EXPECT_GT(luma, last);
    last = luma;
  }
}

PlotOptions Options() {
  PlotOptions options;
  options.title = "a < b & c";
  options.x_label = "x [m]";
  options.y_label = "y [m]";
  return options;
}

TEST(PlotTest, SvgEscapesTextAndLeavesOutWhatIsNotFinite) {
  Plot plot(Options());
  const double nan = std::numeric_limits<double>::quiet_NaN();
  plot.AddLine("line", {0.0, 1.0, 2.0, 3.0}, {0.0, nan, 1.0, 2.0}, {kBlue, 1.0});
  plot.AddDots("dots", {nan, 1.0}, {1.0, std::numeric_limits<double>::infinity()}, {kRed}, 2.0);
  const std::string svg = plot.Svg();
  EXPECT_THAT(svg, HasSubstr("a &lt; b &amp; c"));
  EXPECT_THAT(svg, Not(HasSubstr("nan")));
  EXPECT_THAT(svg, Not(HasSubstr("inf")));
  EXPECT_THAT(svg, ::testing::EndsWith("</svg>\n"));
}

TEST(PlotTest, EmptyAndConstantDataStillDraw) {
  Plot empty(Options());
  EXPECT_THAT(empty.Svg(), HasSubstr("</svg>"));
  Plot constant(Options());
  constant.AddLine("flat", {1.0, 2.0}, {5.0, 5.0}, {kBlue, 1.0});
  constant.AddBars("", {0.0, 1.0, 2.0}, {0.0, 0.0}, kGreen);
  EXPECT_THAT(constant.Svg(), Not(HasSubstr("nan")));
  EXPECT_TRUE(constant.Png());
}

// A circle of data is a circle on paper: the dots' extents agree in px.
TEST(PlotTest, EqualAspectKeepsCirclesRound) {
  class Recorder final : public Canvas {
   public:
    void Line(std::span<const Vec2>, const Stroke&) override {}
    void Fill(const Box&, const Colour&) override {}
    void Dots(std::span<const Vec2> centers, std::span<const Colour>, double) override {
      for (const Vec2& center : centers) {
        low = low.cwiseMin(center);
        high = high.cwiseMax(center);
      }
    }
    void Text(const Vec2&, std::string_view, const TextStyle&) override {}
    void SetClip(const Box*) override {}
    Vec2 low = Vec2::Constant(1e9), high = Vec2::Constant(-1e9);
  };
  PlotOptions options = Options();
  options.equal_aspect = true;
  Plot plot(options);
  std::vector<double> x, y;
  for (int i = 0; i < 360; ++i) {
    x.push_back(3.0 * std::cos(i * 0.0174532925));
    y.push_back(3.0 * std::sin(i * 0.0174532925));
  }
  plot.AddDots("", x, y, {kInk}, 1.0);
  Recorder recorder;
  plot.Draw(&recorder);
  const Vec2 size = recorder.high - recorder.low;
  EXPECT_NEAR(size.x(), size.y(), 0.1);
  EXPECT_GT(size.y(), 200.0);
}

}  // namespace
}  // namespace rsfm

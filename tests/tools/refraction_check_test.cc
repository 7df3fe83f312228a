// Does refraction matter: what `rsfm_tool check --range` measures, and that the bowl is true.
#include <gtest/gtest.h>

#include "tests/support/rigs.h"
#include "tools/check/heat_map.h"
#include "tools/check/transect.h"
#include "tools/offline/bundle.h"

namespace rsfm {
namespace {

constexpr RangeBand kBand{1.0, 8.0};

CameraConfig SmallLens() {
  CameraConfig config;
  config.lens = LensModel::kPinhole;
  config.width = 1200;
  config.height = 800;
  config.lens_params = {1000.0, 1000.0, 600.0, 400.0};
  return config;
}

AnyCamera FlatRig(double distance_m = 0.02) {
  CameraConfig config = SmallLens();
  config.port.type = PortType::kFlat;
  config.port.distance_m = distance_m;
  config.port.thickness_m = 0.01;
  return *AnyCamera::Create(config);
}

AnyCamera DomeRig(const Vec3& center_m) {
  CameraConfig config = SmallLens();
  config.port = CentredDomePort();
  config.port.center_m = center_m;
  return *AnyCamera::Create(config);
}

RefractionEffect Effect(const AnyCamera& camera) {
  return MeasureEffect(*PinholeInWater::Fit(camera, kBand), kBand);
}

TEST(RefractionCheckTest, WithoutDistortionThePinholeIsTheBestFit) {
  Rng rng(4);
  for (const RigKind kind : {RigKind::kFlat, RigKind::kDome}) {
    const AnyCamera camera = RandomRig(kind, &rng);
    const auto fit = FitPerspective(camera, {kBand.near_m, kBand.far_m});
    const auto pinhole = PinholeInWater::Fit(camera, kBand);
    ASSERT_TRUE(fit && pinhole);
    EXPECT_NEAR(pinhole->fit().fx, fit->fx, 1e-9 * fit->fx);
    EXPECT_NEAR(pinhole->fit().cy, fit->cy, 1e-9 * fit->fx);
  }
}

TEST(RefractionCheckTest, WithoutAPortNothingIsLost) {
  CameraConfig config = SmallLens();
  config.lens = LensModel::kOpenCV;  // what the lens distorts is not refraction
  config.lens_params = {1000.0, 1010.0, 600.0, 400.0, -0.2, 0.05, 1e-3, -1e-3};
  const RefractionEffect effect = Effect(*AnyCamera::Create(config));
  EXPECT_LT(effect.max_px, 1e-6);
  EXPECT_LT(effect.max_miss_m, 1e-12);
  for (const RangeEffect& at : effect.ranges) EXPECT_LT(std::abs(at.length_bias), 1e-9);
}

TEST(RefractionCheckTest, ACentredDomeIsCentral) {
  const RefractionEffect effect = Effect(DomeRig(Vec3::Zero()));
  EXPECT_LT(effect.max_px, 1e-6);
  EXPECT_LT(effect.max_miss_m, 1e-12);
  EXPECT_LT(effect.nearest_center_m.norm(), 1e-12);
}

// Near the axis a flat port moves the centre of projection towards the water by
// d (1 - n_air/n_water) + t (...) and magnifies by the index: what is nearer looks larger.
TEST(RefractionCheckTest, AFlatPortBiasesNearAndFarApart) {
  const RefractionEffect effect = Effect(FlatRig());
  EXPECT_GT(effect.max_px, 1.0);
  EXPECT_GT(effect.max_miss_m, 1e-4);
  EXPECT_LT(effect.mean_miss_m, effect.max_miss_m);
  EXPECT_GT(effect.ranges.front().range_m, 0.999);
  EXPECT_NEAR(effect.ranges.back().range_m, 8.0, 1e-9);
  // Every range's numbers lie under the whole's.
  double worst = 0.0;
  for (const RangeEffect& at : effect.ranges) {
    EXPECT_LE(at.mean_px, at.max_px);
    worst = std::max(worst, at.max_px);
  }
  EXPECT_EQ(worst, effect.max_px);
  // The farther away the glass, the less is it a pinhole.
  EXPECT_GT(Effect(FlatRig(0.1)).max_miss_m, 2.0 * effect.max_miss_m);
}

// By hand: two points of an object across the view at 1 m, through the exact camera and back
// through the pinhole.
TEST(RefractionCheckTest, TheLengthBiasIsWhatAPairOfPointsShows) {
  const AnyCamera camera = FlatRig(0.05);
  const auto pinhole = PinholeInWater::Fit(camera, kBand);
  ASSERT_TRUE(pinhole);
  const RefractionEffect effect = MeasureEffect(*pinhole, kBand);
  const auto measured = [&](double z) {
    Vec2 left, right;
    EXPECT_EQ(camera.Project({-0.25 * z, 0, z}, &left), Projection::kOk);
    EXPECT_EQ(camera.Project({0.25 * z, 0, z}, &right), Projection::kOk);
    return z * (pinhole->fit().Normalise(right) - pinhole->fit().Normalise(left)).x() / (0.5 * z) -
           1.0;
  };
  const double by_hand = measured(1.0) - measured(8.0);
  const double found = effect.ranges.front().length_bias - effect.ranges.back().length_bias;
  EXPECT_GT(std::abs(by_hand), 1e-3);
  EXPECT_NEAR(found, by_hand, 0.25 * std::abs(by_hand));
}

TEST(RefractionCheckTest, BadBandsAreRefused) {
  for (const RangeBand& band : {RangeBand{0.0, 8.0}, RangeBand{8.0, 1.0}, RangeBand{-1.0, 1.0},
                                RangeBand{std::nan(""), 1.0}, RangeBand{1.0, INFINITY}}) {
    EXPECT_FALSE(PinholeInWater::Fit(FlatRig(), band));
  }
}

TransectReport Fly(const AnyCamera& camera, double length_m, int rows = 32) {
  TransectOptions options;
  options.length_m = length_m;
  options.altitude_m = 3.0;
  options.rows = rows;
  const auto report = SimulateTransect(*PinholeInWater::Fit(camera, kBand), options);
  EXPECT_TRUE(report);
  return report.value_or(TransectReport());
}

TEST(TransectTest, ATruePinholeStaysStraight) {
  for (const AnyCamera& camera : {*AnyCamera::Create(SmallLens()), DomeRig(Vec3::Zero())}) {
    const TransectReport report = Fly(camera, 50.0);
    EXPECT_LT(std::abs(report.sagitta_m), 1e-5);
    EXPECT_LT(report.mean_error_px, 1e-6);
  }
}

// A strip with ends, adjusted whole: poses and points, as anyone would. The camera looks down, its
// image's y axis backwards along the track.
// The sagitta between two of its images, in parts of their distance.
double SagittaOfAWholeStrip(const PinholeInWater& pinhole, double spacing_m, int num_images,
                            int first, int last) {
  BundleProblem problem;
  const BestFitPerspective& fit = pinhole.fit();
  CameraConfig ideal;
  ideal.lens = LensModel::kPinhole;
  ideal.width = pinhole.camera().config().width;
  ideal.height = pinhole.camera().config().height;
  ideal.lens_params = {fit.fx, fit.fy, fit.cx, fit.cy};
  problem.cameras = {ideal};
  Mat3 down;
  down << 0, 1, 0, -1, 0, 0, 0, 0, 1;  // rows: the camera's axes in the world
  for (int i = 0; i < num_images; ++i) {
    const Rigid3 world_from_camera(Quat(Mat3(down.transpose())), Vec3(i * spacing_m, 0.0, -3.0));
    problem.images.push_back({world_from_camera.Inverse(), 0, false});
  }
  for (double x = -3.0; x < num_images * spacing_m + 3.0; x += 0.25 * spacing_m) {
    for (double y = -4.0; y <= 4.0; y += 0.25) {
      std::vector<BundleObservation> seen;
      for (int i = 0; i < num_images; ++i) {
        Vec2 pixel, undistorted;
        const Vec3 point = problem.images[i].camera_from_world * Vec3(x, y, 0.0);
        if (pinhole.camera().Project(point, &pixel) == Projection::kOk &&
            pinhole.camera().IsInImage(pixel) && pinhole.Undistort(pixel, &undistorted)) {
          seen.push_back({i, static_cast<int>(problem.points.size()), undistorted});
        }
      }
      if (seen.size() < 2) continue;
      problem.points.push_back({x, y, 0.0});
      problem.observations.insert(problem.observations.end(), seen.begin(), seen.end());
    }
  }
  BundleOptions options;
  options.loss.type = LossType::kNone;
  options.max_iterations = 300;
  options.function_tolerance = 1e-12;
  const auto adjusted = AdjustBundle(options, &problem);
  EXPECT_TRUE(adjusted && adjusted->converged);
  const int middle = (first + last) / 2;
  const Rigid3& eye = problem.images[middle].camera_from_world;
  const Vec3 a = eye * problem.images[first].camera_from_world.OriginOfTarget();
  const Vec3 b = eye * problem.images[last].camera_from_world.OriginOfTarget();
  return -0.5 * (a + b).z() / (a - b).norm();
}

TEST(TransectTest, TheMiddleOfAWholeStripIsBentAlike) {
  for (const AnyCamera& camera : {FlatRig(0.05), DomeRig({0.0, 0.0, 0.01})}) {
    const auto pinhole = PinholeInWater::Fit(camera, kBand);
    ASSERT_TRUE(pinhole);
    const auto report = SimulateTransect(*pinhole, TransectOptions());
    ASSERT_TRUE(report);
    const double whole = SagittaOfAWholeStrip(*pinhole, report->spacing_m, 25, 8, 16);
    const double half_angle = 4 * report->spacing_m * report->curvature_per_m;
    const double step = 0.5 * std::tan(0.5 * half_angle);
    EXPECT_GT(std::abs(step), 1e-4);
    EXPECT_NEAR(whole, step, 0.1 * std::abs(step));
  }
}

// While the circle is a shallow one its depth grows with the square of the length; in the end it is
// the diameter.
TEST(TransectTest, TheBowlIsACircle) {
  for (const AnyCamera& camera : {FlatRig(), DomeRig({0.0, 0.0, 0.01})}) {
    const TransectReport quarter = Fly(camera, 0.5), half = Fly(camera, 1.0);
    EXPECT_GT(std::abs(half.sagitta_m), 1e-5);
    EXPECT_NEAR(half.sagitta_m / quarter.sagitta_m, 4.0, 0.1);
    EXPECT_NEAR(Fly(camera, 1e6).sagitta_m * half.curvature_per_m, 2.0, 1e-9);
  }
}

// The bowl is the model's, not that of how densely the seabed is sampled.
TEST(TransectTest, TheSamplingDoesNotMatter) {
  const double sparse = Fly(FlatRig(), 25.0, 24).sagitta_m;
  const double dense = Fly(FlatRig(), 25.0, 48).sagitta_m;
  EXPECT_NEAR(sparse, dense, 0.05 * std::abs(dense));
  EXPECT_EQ(sparse, Fly(FlatRig(), 25.0, 24).sagitta_m);  // and it is deterministic
}

TEST(TransectTest, OptionsAreChecked) {
  const auto pinhole = PinholeInWater::Fit(FlatRig(), kBand);
  TransectOptions options;
  options.altitude_m = -1.0;
  EXPECT_FALSE(SimulateTransect(*pinhole, options));
  options = {};
  options.forward_overlap = 1.0;
  EXPECT_FALSE(SimulateTransect(*pinhole, options));
}

TEST(HeatMapTest, ShowsEveryCellAndItsUnits) {
  const AnyCamera camera = FlatRig();
  const RefractionEffect effect = Effect(camera);
  ASSERT_EQ(effect.cell_max_px.size(), static_cast<std::size_t>(kEffectColumns * kEffectRows));
  const Vec2 size = HeatMapSize(camera);
  SvgCanvas svg(size.x(), size.y());
  DrawHeatMap(camera, effect, "title <1>", "verdict", &svg);
  const std::string text = svg.Finish();
  std::size_t num_rects = 0;
  for (std::size_t at = 0; (at = text.find("<rect", at)) != std::string::npos; ++at) ++num_rects;
  EXPECT_GE(num_rects, effect.cell_max_px.size());
  for (const char* part : {"title &lt;1&gt;", "verdict", "largest error in the band [px]",
                           "image column [px]", "from 1 to 8 m", "</svg>"}) {
    EXPECT_NE(text.find(part), std::string::npos) << part;
  }
  RasterCanvas raster(size.x(), size.y());
  DrawHeatMap(camera, effect, "title", "verdict", &raster);
  EXPECT_TRUE(raster.Finish());
}

}  // namespace
}  // namespace rsfm

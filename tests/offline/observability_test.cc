#include "tools/offline/observability.h"

#include <gtest/gtest.h>

#include "tests/support/rigs.h"
#include "tests/support/survey.h"
#include "tools/offline/bend.h"

namespace rsfm {
namespace {

struct Solved {
  CameraConfig start;
  BundleProblem problem;
};

CameraConfig Rig() {
  CameraConfig config = PaperLens();
  config.port.type = PortType::kFlat;
  config.port.normal = Vec3(0.1, 0.05, 1.0).normalized();
  config.port.distance_m = 0.02;
  config.port.thickness_m = 0.01;
  return config;
}

SurveyOptions ThreeLines(std::uint64_t seed) {
  SurveyOptions options;
  options.lines = 3;
  options.images_per_line = 5;
  options.num_points = 400;
  options.seed = seed;
  return options;
}

Solved Solve(const CameraConfig& config, const BundleOptions& options, const Survey& survey,
             bool positions) {
  Solved solved;
  solved.start = config;
  solved.problem.cameras = {config};
  for (const Rigid3& pose : survey.camera_from_world)
    solved.problem.images.push_back({pose, 0, false});
  solved.problem.points = survey.points;
  for (const SurveyObservation& o : survey.observations)
    solved.problem.observations.push_back({o.image, o.point, o.pixel});
  for (int k = 0; positions && k < static_cast<int>(solved.problem.images.size()); ++k)
    solved.problem.priors.push_back(*MakePositionPrior(
        k, Rigid3(), survey.camera_from_world[k].OriginOfTarget(), Vec3::Constant(0.01)));
  EXPECT_TRUE(AdjustBundle(options, &solved.problem));
  return solved;
}

Survey TrueSurvey(const CameraConfig& config, std::uint64_t seed) {
  return MakeSurvey(*AnyCamera::Create(config), ThreeLines(seed));
}

Solved Solve(const CameraConfig& config, const BundleOptions& options, std::uint64_t seed,
             bool positions) {
  return Solve(config, options, TrueSurvey(config, seed), positions);
}

TEST(ObservabilityTest, SigmasAreThoseOfRepeatedExperiments) {
  BundleOptions options;
  options.loss.type = LossType::kNone;
  options.lens.focal = true;
  options.port.normal = true;
  constexpr int kExperiments = 12;
  std::vector<double> squares;
  std::vector<ParameterEstimate> estimates;
  double noise = 0.0;
  const CameraConfig truth = Rig();
  for (int i = 0; i < kExperiments; ++i) {
    const Solved solved = Solve(truth, options, 100 + static_cast<std::uint64_t>(i), false);
    const auto report = AnalyseObservability(options, options, {solved.start}, solved.problem);
    ASSERT_TRUE(report);
    estimates = report->parameters;
    noise += report->noise_px / kExperiments;
    squares.resize(estimates.size());
    for (std::size_t p = 0; p < estimates.size(); ++p)
      squares[p] += std::pow((estimates[p].value - estimates[p].start) / estimates[p].sigma, 2);
  }
  ASSERT_EQ(estimates.size(), 4u);
  EXPECT_EQ(estimates[0].name, "fx");
  EXPECT_EQ(estimates[2].name, "port.normal_x");
  EXPECT_NEAR(noise, 0.5, 0.05);
  // Twelve squared normal deviates: between 3 and 30 but for one time in a thousand.
  for (std::size_t p = 0; p < squares.size(); ++p) {
    EXPECT_GT(squares[p], 3.0) << estimates[p].name;
    EXPECT_LT(squares[p], 30.0) << estimates[p].name;
    EXPECT_EQ(estimates[p].verdict, "well determined");
  }
}

TEST(ObservabilityTest, DistanceGoesWithTheScale) {
  BundleOptions options;
  options.port.distance = true;
  const Solved held = Solve(Rig(), options, 1, false);
  const auto without = AnalyseObservability(options, options, {held.start}, held.problem);
  ASSERT_TRUE(without);
  EXPECT_GT(without->scale_sigma, 0.02);  // the images do not know it
  EXPECT_GT(std::abs(without->parameters[0].scale_correlation), 0.5);
  const Solved fixed = Solve(Rig(), options, 1, true);
  const auto with = AnalyseObservability(options, options, {fixed.start}, fixed.problem);
  ASSERT_TRUE(with);
  EXPECT_LT(with->scale_sigma, 0.01);  // positions do
  EXPECT_LT(std::abs(with->parameters[0].scale_correlation), 0.5);
}

TEST(ObservabilityTest, NothingRefinedIsAnEmptyList) {
  const Solved solved = Solve(Rig(), {}, 1, false);
  const auto report = AnalyseObservability({}, {}, {solved.start}, solved.problem);
  ASSERT_TRUE(report);
  EXPECT_TRUE(report->parameters.empty());
}

// Twelve experiments: the bend's error against its own sigma.
TEST(ObservabilityTest, SigmaOfTheBendIsThatOfRepeatedExperiments) {
  const CameraConfig truth = Rig();
  double squares = 0.0;
  for (int i = 0; i < 12; ++i) {
    const auto seed = 300 + static_cast<std::uint64_t>(i);
    BundleOptions options;
    options.loss.type = LossType::kNone;
    const Solved solved = Solve(truth, options, seed, false);
    const auto report = AnalyseObservability(options, options, {solved.start}, solved.problem);
    ASSERT_TRUE(report && report->bend);
    std::vector<Vec3> places;
    Vec3 up = Vec3::Zero();
    for (const Rigid3& pose : TrueSurvey(truth, seed).camera_from_world) {
      places.push_back(pose.OriginOfTarget());
      up -= pose.rotation.conjugate() * Vec3::UnitZ();
    }
    squares += std::pow(
        (report->bend->sagitta_m - FitBend(places, up)->sagitta_m) / report->bend->sigma_m, 2);
  }
  EXPECT_GT(squares, 3.0);
  EXPECT_LT(squares, 30.0);
}

// A level camera over level ground: distortion and a bowl look alike.
//   [James & Robson 2014, Earth Surf. Process. Landforms 39]
TEST(ObservabilityTest, AFreeLensLeavesTheBendOpen) {
  SurveyOptions level = ThreeLines(1);
  level.tilt_rad = 0.0;
  level.relief_m = 0.02;
  const Survey survey = MakeSurvey(*AnyCamera::Create(Rig()), level);
  BundleOptions free;
  free.lens.focal = free.lens.distortion = true;
  const Solved known = Solve(Rig(), {}, survey, false), refined = Solve(Rig(), free, survey, false);
  const auto with = AnalyseObservability({}, {}, {known.start}, known.problem);
  const auto without = AnalyseObservability(free, free, {refined.start}, refined.problem);
  ASSERT_TRUE(without && with && without->bend && with->bend);
  EXPECT_GT(without->bend->sigma_m, 2.0 * with->bend->sigma_m);
}

// A camera file whose focal length is 10 % off, or whose port is tilted another way, is found out;
// a right one is not accused.
TEST(ObservabilityTest, DoubtsAWrongCameraFile) {
  const CameraConfig truth = Rig();
  const auto analyse = [&](const CameraConfig& file) {
    Solved solved = Solve(truth, {}, 1, true);
    solved.problem.cameras = {file};
    EXPECT_TRUE(AdjustBundle({}, &solved.problem));
    const auto report = AnalyseObservability({}, {}, {file}, solved.problem);
    EXPECT_TRUE(report);
    return *report;
  };
  const ObservabilityReport right = analyse(truth);
  ASSERT_EQ(right.held.size(), 4u);  // fx, fy and two of the normal
  EXPECT_LT(right.held_sigmas, 2.0);
  for (const ParameterDoubt& d : right.held) EXPECT_LT(std::abs(d.step), 4.0 * d.sigma) << d.name;
  CameraConfig longer = truth;
  longer.lens_params[0] *= 1.1;
  longer.lens_params[1] *= 1.1;
  const ObservabilityReport focal = analyse(longer);
  EXPECT_EQ(focal.held[0].name, "fx");
  EXPECT_LT(focal.held[0].step, -0.03 * longer.lens_params[0]);
  EXPECT_GT(focal.held_sigmas, 5.0);
  CameraConfig tilted = truth;
  tilted.port.normal = Vec3(0.0, 0.05, 1.0).normalized();
  const ObservabilityReport normal = analyse(tilted);
  EXPECT_GT(normal.held_sigmas, 5.0);
  bool found = false;
  for (const ParameterDoubt& d : normal.held) {
    if (d.name != "port.normal_x") continue;
    found = true;
    EXPECT_NEAR(d.step, 0.1, 0.05);
  }
  EXPECT_TRUE(found);
}

TEST(ObservabilityTest, Words) {
  EXPECT_EQ(Verdict(0.01, 1.0), "well determined");
  EXPECT_EQ(Verdict(0.3, 1.0), "determined");
  EXPECT_EQ(Verdict(0.6, 1.0), "weakly determined");
  EXPECT_EQ(Verdict(0.95, 1.0), "not determined");
  EXPECT_EQ(Verdict(std::nan(""), 1.0), "not determined");
}

}  // namespace
}  // namespace rsfm

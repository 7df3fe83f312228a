#include "tools/offline/observability.h"

#include <gtest/gtest.h>

#include "tests/support/rigs.h"
#include "tests/support/survey.h"

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

Solved Solve(const CameraConfig& config, const BundleOptions& options, std::uint64_t seed,
             bool positions) {
  const AnyCamera camera = *AnyCamera::Create(config);
  SurveyOptions survey_options;
  survey_options.lines = 3;
  survey_options.images_per_line = 5;
  survey_options.num_points = 400;
  survey_options.seed = seed;
  const Survey survey = MakeSurvey(camera, survey_options);
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
    const auto report = AnalyseObservability(options, {solved.start}, solved.problem);
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
  const auto without = AnalyseObservability(options, {held.start}, held.problem);
  ASSERT_TRUE(without);
  EXPECT_GT(without->scale_sigma, 0.02);  // the images do not know it
  EXPECT_GT(std::abs(without->parameters[0].scale_correlation), 0.5);
  const Solved fixed = Solve(Rig(), options, 1, true);
  const auto with = AnalyseObservability(options, {fixed.start}, fixed.problem);
  ASSERT_TRUE(with);
  EXPECT_LT(with->scale_sigma, 0.01);  // positions do
  EXPECT_LT(std::abs(with->parameters[0].scale_correlation), 0.5);
}

TEST(ObservabilityTest, NothingRefinedIsAnEmptyList) {
  const Solved solved = Solve(Rig(), {}, 1, false);
  const auto report = AnalyseObservability({}, {solved.start}, solved.problem);
  ASSERT_TRUE(report);
  EXPECT_TRUE(report->parameters.empty());
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

// A hundred images, focal length and port unknown: where refractive bundle adjustment by
// virtual-image errors loses the scale or collapses altogether. From nothing but features, one
// image after the other, with navigation.
#include <gtest/gtest.h>

#include "tests/offline/alignment.h"
#include "tests/offline/made_scene.h"
#include "tests/support/rigs.h"
#include "tools/offline/navigation.h"
#include "tools/offline/refine_scene.h"

namespace rsfm {
namespace {

class IncrementalSelfCalibrationTest : public testing::TestWithParam<PortType> {};

// Positions to 5 cm, attitude to half a degree.
NavigationInput MakeNavigation(const Survey& truth, const Scene& scene) {
  NavigationInput input;
  input.body_from_camera = Rigid3(ExpSo3(Vec3(0.02, 0.0, 1.5)), Vec3(0.4, -0.2, 0.3));
  Rng rng(8);
  const auto noise = [&rng](double sigma) {
    return Vec3(rng.Gaussian(0.0, sigma), rng.Gaussian(0.0, sigma), rng.Gaussian(0.0, sigma));
  };
  for (std::size_t k = 0; k < truth.camera_from_world.size(); ++k) {
    const Rigid3 body = (input.body_from_camera * truth.camera_from_world[k]).Inverse();
    NavSample s;
    s.utime = scene.images[k].utime;
    s.Set(NavField::kPosition);
    s.Set(NavField::kAttitude);
    s.position_ned_m = body.translation + noise(0.05);
    s.sigma_position_m = Vec3::Constant(0.05);
    s.ned_from_body = ExpSo3(noise(0.01)) * body.rotation;
    s.sigma_attitude_rad = Vec3::Constant(0.01);
    input.samples.push_back(s);
  }
  return input;
}

TEST_P(IncrementalSelfCalibrationTest, KeepsAllImagesScaleAndFocalLength) {
  CameraConfig truth_config = PaperLens();
  truth_config.port.type = GetParam();
  truth_config.port.normal = Vec3(0.08, -0.05, 1.0).normalized();
  truth_config.port.distance_m = 0.025;
  truth_config.port.center_m = Vec3(0.004, -0.003, 0.008);
  truth_config.port.radius_m = 0.06;
  truth_config.port.thickness_m = 0.01;
  SurveyOptions options;
  options.lines = options.images_per_line = 10;
  options.num_points = 2500;
  options.forward_m = 0.5;
  options.sideways_m = 0.8;
  const Survey truth = MakeSurvey(*AnyCamera::Create(truth_config), options);
  CameraConfig config = truth_config;
  config.lens_params[0] *= 1.02;
  config.lens_params[1] *= 1.02;
  config.port.normal = Vec3::UnitZ();
  config.port.distance_m = 0.02;
  config.port.center_m = Vec3::Zero();
  Scene scene = MakeScene(config, truth, {.placed = false, .clutter = 5});
  const NavigationInput navigation = MakeNavigation(truth, scene);
  RefineSceneOptions refine;
  refine.match.sequence_neighbours = 6;
  refine.match.all_unplaced_up_to = 0;
  refine.settle_first = false;
  refine.bundle.lens.focal = true;
  refine.bundle.port.normal = refine.bundle.port.distance = refine.bundle.port.center = true;
  refine.navigate = [&](Scene* s) {
    AlignToNavigation(navigation, s);
    s->priors = NavigationPriors(navigation, *s);
  };
  const auto report = RefineScene(refine, &scene);
  ASSERT_TRUE(report) << report.error().where;
  EXPECT_TRUE(report->from_scratch);
  EXPECT_EQ(scene.NumPlaced(), 100);
  EXPECT_TRUE(report->rounds.back().bundle.converged);
  EXPECT_LT(report->errors.mean_px, 0.64);  // 0.5 px in two dimensions: 0.627 px
  for (const int i : {0, 1})
    EXPECT_NEAR(scene.camera.lens_params[i] / truth_config.lens_params[i], 1.0, 0.005);
  std::vector<Vec3> found, places;
  for (std::size_t k = 0; k < scene.images.size(); ++k) {
    found.push_back(scene.images[k].camera_from_world.OriginOfTarget());
    places.push_back(truth.camera_from_world[k].OriginOfTarget());
  }
  const Alignment alignment = AlignPlaces(found, places);
  EXPECT_NEAR(alignment.scale, 1.0, 0.01);
  EXPECT_LT(alignment.rms_m, 0.02);
}

INSTANTIATE_TEST_SUITE_P(Ports, IncrementalSelfCalibrationTest,
                         testing::Values(PortType::kFlat, PortType::kDome));

}  // namespace
}  // namespace rsfm

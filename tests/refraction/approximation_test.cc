// The best-fit perspective camera, virtual cameras, and what Create refuses.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>

#include "rsfm/refraction/best_fit.h"
#include "rsfm/refraction/virtual_camera.h"
#include "tests/support/malloc_trap.h"
#include "tests/support/rigs.h"

namespace rsfm {
namespace {

TEST(BestFit, ACentralCameraIsItsOwnBestFit) {
  Rng rng(41);
  for (const RigKind kind : {RigKind::kNone, RigKind::kCentredDome}) {
    const auto fit = FitPerspective(RandomRig(kind, &rng));
    ASSERT_TRUE(fit);
    EXPECT_NEAR(fit->fx, 1297.37, 1e-8);
    EXPECT_NEAR(fit->fy, 1297.37, 1e-8);
    EXPECT_NEAR(fit->cx, 960.0, 1e-8);
    EXPECT_NEAR(fit->cy, 540.0, 1e-8);
    EXPECT_LT(fit->max_error_px, 1e-8);
  }
}

TEST(BestFit, NoOtherPinholeIsNearer) {
  Rng rng(42);
  for (int rig = 0; rig < 20; ++rig) {
    const AnyCamera camera = RandomRig(rig % 2 ? RigKind::kFlat : RigKind::kDome, &rng);
    const auto fit = FitPerspective(camera);
    ASSERT_TRUE(fit);
    EXPECT_GT(fit->max_error_px, fit->rms_error_px);
    const auto cost = [&](const BestFitPerspective& f) {
      double sum = 0;
      for (int i = 0; i < 1000; ++i) {
        const Vec2 pixel((i % 40 + 0.5) * 48.0, (i / 40 + 0.5) * 43.2);
        Ray3 ray;
        if (camera.Backproject(pixel, &ray) == Projection::kOk)
          sum += (f.Project(ray.At(5.0)) - pixel).squaredNorm();
      }
      return sum;
    };
    const double best = cost(*fit);
    EXPECT_NEAR(std::sqrt(best / 1000), fit->rms_error_px, 1e-9);
    for (double BestFitPerspective::*member : {&BestFitPerspective::fx, &BestFitPerspective::fy,
                                               &BestFitPerspective::cx, &BestFitPerspective::cy}) {
      for (const double step : {-0.1, 0.1}) {
        BestFitPerspective other = *fit;
        other.*member += step;
        EXPECT_GT(cost(other), best);
      }
    }
  }
}

TEST(BestFit, WaterMagnifiesBehindAFlatPort) {
  CameraConfig config = PaperLens();
  config.port.type = PortType::kFlat;
  config.port.distance_m = 0.001;
  config.port.thickness_m = 0.002;
  const auto fit =
      FitPerspective(*AnyCamera::Create(config), {.min_range_m = 2.0, .max_range_m = 10.0});
  ASSERT_TRUE(fit);
  EXPECT_GT(fit->fx / 1297.37, 1.334);  // and more off the axis
  EXPECT_LT(fit->fx / 1297.37, 1.6);
}

TEST(BestFit, RefusesABandThatIsNone) {
  Rng rng(43);
  const AnyCamera camera = RandomRig(RigKind::kFlat, &rng);
  for (const auto& [low, high] :
       {std::pair{0.0, 1.0}, {2.0, 1.0}, {-1.0, 1.0}, {1.0, INFINITY}, {NAN, 1.0}}) {
    const auto fit = FitPerspective(camera, {.min_range_m = low, .max_range_m = high});
    ASSERT_FALSE(fit);
    EXPECT_EQ(fit.error().code, Errc::kInvalidArgument);
  }
}

TEST(BestFit, DoesNotAllocate) {
  Rng rng(44);
  const AnyCamera camera = RandomRig(RigKind::kDome, &rng);
  MallocTrap trap;
  EXPECT_TRUE(FitPerspective(camera));
  EXPECT_EQ(trap.count(), 0u);
}

TEST(VirtualCamera, SeesTheRayOfItsPixelAndLiesOnTheAxis) {
  Rng rng(45);
  for (const RigKind kind :
       {RigKind::kNone, RigKind::kFlat, RigKind::kDome, RigKind::kCentredDome}) {
    for (int i = 0; i < 300; ++i) {
      const AnyCamera camera = RandomRig(kind, &rng);
      const Vec2 pixel(rng.Uniform(0, 1920), rng.Uniform(0, 1080));
      VirtualCamera virtual_camera;
      ASSERT_EQ(ComputeVirtualCamera(camera, pixel, &virtual_camera), Projection::kOk);
      Ray3 ray;
      ASSERT_EQ(camera.Backproject(pixel, &ray), Projection::kOk);
      EXPECT_LT(ray.Distance(virtual_camera.center_in_camera), 1e-12);
      EXPECT_EQ(virtual_camera.focal_px, 1297.37);
      for (const double range : {0.2, 3.0, 50.0})
        EXPECT_LT((virtual_camera.Project(ray.At(range)) - pixel).norm(), 1e-9);
      if (kind == RigKind::kFlat) {
        EXPECT_LT(camera.RefractionAxis().cross(virtual_camera.center_in_camera).norm(), 1e-9);
      }
    }
  }
}

TEST(VirtualCamera, PixelOnTheAxisIsWellDefined) {
  CameraConfig config = PaperLens();
  config.port = CentredDomePort();
  config.port.type = PortType::kFlat;
  config.port.distance_m = 0.02;
  const AnyCamera camera = *AnyCamera::Create(config);
  for (const double offset : {0.0, 1e-9, 1e-3, 0.05, 0.2, 1.0}) {
    VirtualCamera virtual_camera;
    ASSERT_EQ(ComputeVirtualCamera(camera, Vec2(960.0 + offset, 540.0), &virtual_camera),
              Projection::kOk);
    EXPECT_TRUE(virtual_camera.center_in_camera.allFinite());
    EXPECT_LT(virtual_camera.center_in_camera.norm(), 0.05);
    EXPECT_LT((virtual_camera.Project(Vec3(0, 0, 5)) - Vec2(960, 540)).norm(), 2.0);
  }
}

TEST(Create, NamesTheFieldItRefuses) {
  Rng rng(46);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto refused = [](const CameraConfig& config, const char* field) {
    const auto camera = AnyCamera::Create(config);
    ASSERT_FALSE(camera) << field;
    EXPECT_EQ(camera.error().code, Errc::kInvalidArgument);
    EXPECT_STREQ(camera.error().where, field);
  };
  CameraConfig flat = PaperLens(), dome = PaperLens();
  flat.port = RandomFlatPort(&rng);
  dome.port = RandomDomePort(&rng);
  ASSERT_TRUE(AnyCamera::Create(flat));
  ASSERT_TRUE(AnyCamera::Create(dome));
  const auto with = [](CameraConfig config, auto&& change) {
    change(config);
    return config;
  };
  refused(with(flat, [](auto& c) { c.width = 0; }), "width");
  refused(with(flat, [](auto& c) { c.height = -5; }), "height");
  refused(with(flat, [](auto& c) { c.lens_params.pop_back(); }), "params");
  refused(with(flat, [&](auto& c) { c.lens_params[2] = nan; }), "params");
  refused(with(flat, [](auto& c) { c.lens_params[0] = -1; }), "params");
  refused(with(flat, [](auto& c) { c.lens = static_cast<LensModel>(99); }), "model");
  refused(with(flat, [](auto& c) { c.port.normal *= 1.01; }), "normal");
  refused(with(flat, [](auto& c) { c.port.normal *= -1.0; }), "normal");
  refused(with(flat, [&](auto& c) { c.port.normal.x() = nan; }), "normal");
  refused(with(flat, [](auto& c) { c.port.distance_m = -0.01; }), "distance_m");
  refused(with(flat, [](auto& c) { c.port.thickness_m = -0.01; }), "thickness_m");
  refused(with(flat, [&](auto& c) { c.port.thickness_m = nan; }), "thickness_m");
  refused(with(flat, [](auto& c) { c.port.index_air = 0.9; }), "index_air");
  refused(with(flat, [](auto& c) { c.port.index_glass = 0.5; }), "index_glass");
  refused(with(flat, [&](auto& c) { c.port.index_water = INFINITY; }), "index_water");
  refused(with(dome, [](auto& c) { c.port.radius_m = 0.0; }), "radius_m");
  refused(with(dome, [](auto& c) { c.port.center_m = Vec3(0, 0, 0.2); }), "center_m");
  refused(with(dome, [&](auto& c) { c.port.center_m.y() = nan; }), "center_m");
}

}  // namespace
}  // namespace rsfm

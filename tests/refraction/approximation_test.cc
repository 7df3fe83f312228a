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
       {RigKind::kNone, RigKind::kFlat, RigKind::kDome, RigKind::kCentredDome, RigKind::kLayered}) {
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
      if (kind == RigKind::kFlat || kind == RigKind::kLayered) {
        EXPECT_LT(camera.RefractionAxis().cross(virtual_camera.center_in_camera).norm(), 1e-9);
      }
    }
  }
}

// Where ray and axis coincide their meeting is ill-conditioned; the centre goes to its limit all
// the same, evenly and without noise.
TEST(VirtualCamera, CentreIsContinuousUpToTheAxis) {
  Rng rng(47);
  for (const RigKind kind : {RigKind::kFlat, RigKind::kDome, RigKind::kLayered}) {
    for (int rig = 0; rig < 20; ++rig) {
      CameraConfig config = PaperLens();
      config.port = RandomRig(kind, &rng).config().port;
      if (kind == RigKind::kDome) {  // towards the front, so that the axis is in the image
        config.port.center_m =
            Vec3(rng.Uniform(-0.002, 0.002), rng.Uniform(-0.002, 0.002), rng.Uniform(0.005, 0.03));
        if (rig % 2 == 1) config.port.center_m *= -1.0;
      }
      const AnyCamera camera = *AnyCamera::Create(config);
      Vec3 axis = camera.RefractionAxis();
      if (axis.z() < 0.0) axis = -axis;
      const Vec2 on_axis = 1297.37 * axis.head<2>() / axis.z() + Vec2(960.0, 540.0);
      VirtualCamera limit;
      ASSERT_EQ(ComputeVirtualCamera(camera, on_axis, &limit), Projection::kOk);
      // On the axis itself, and not the camera's own centre.
      EXPECT_LT(limit.center_in_camera.cross(axis).norm(), 1e-12);
      EXPECT_GT(limit.center_in_camera.norm(), 1e-5);
      for (const double offset : {1e-12, 1e-9, 1e-6, 1e-3, 1e-1, 1.0}) {
        VirtualCamera near;
        ASSERT_EQ(ComputeVirtualCamera(camera, on_axis + offset * Vec2(0.6, -0.8), &near),
                  Projection::kOk);
        EXPECT_LT((near.center_in_camera - limit.center_in_camera).norm(), 1e-5 * offset + 1e-11)
            << offset;
      }
    }
  }
}

TEST(VirtualCamera, NearlyCentredDomesGoToTheCameraItself) {
  Rng rng(48);
  for (int rig = 0; rig < 50; ++rig) {
    CameraConfig config = PaperLens();
    config.port = CentredDomePort();
    const Vec3 direction = Vec3(rng.Gaussian(), rng.Gaussian(), rng.Gaussian()).normalized();
    const Vec2 pixel(rng.Uniform(0, 1920), rng.Uniform(0, 1080));
    for (const double decentring : {0.0, 1e-300, 1e-20, 1e-15, 1e-12, 1e-9, 1e-6, 1e-4}) {
      config.port.center_m = decentring * direction;
      const AnyCamera camera = *AnyCamera::Create(config);
      VirtualCamera virtual_camera;
      ASSERT_EQ(ComputeVirtualCamera(camera, pixel, &virtual_camera), Projection::kOk);
      EXPECT_LT(virtual_camera.center_in_camera.norm(), 3.0 * decentring + 1e-16);
      Ray3 ray;
      ASSERT_EQ(camera.Backproject(pixel, &ray), Projection::kOk);
      EXPECT_LT(ray.Distance(virtual_camera.center_in_camera), 1e-15);
      for (const double range : {0.1, 5.0})
        EXPECT_LT((virtual_camera.Project(ray.At(range)) - pixel).norm(), 1e-9);
    }
  }
}

TEST(VirtualCamera, ARayThatIsParallelToTheAxisHasACentreAllTheSame) {
  // A camera far behind the dome's centre sees some rays parallel to the axis.
  CameraConfig config = PaperLens();
  config.lens_params = {300.0, 300.0, 960.0, 540.0};
  config.port = CentredDomePort();
  config.port.index_water = 2.5;  // exaggerated, so that it happens within the image
  for (const double depth : {-0.058, 0.058}) {
    config.port.center_m = Vec3(0.0, 0.0, depth);
    const AnyCamera camera = *AnyCamera::Create(config);
    for (double x = 960.0; x < 1920.0; x += 0.5) {
      VirtualCamera virtual_camera;
      const Projection status = ComputeVirtualCamera(camera, Vec2(x, 540.0), &virtual_camera);
      if (status != Projection::kOk) continue;
      Ray3 ray;
      ASSERT_EQ(camera.Backproject(Vec2(x, 540.0), &ray), Projection::kOk);
      ASSERT_TRUE(virtual_camera.center_in_camera.allFinite());
      ASSERT_LE(ray.RangeTo(virtual_camera.center_in_camera), 1e-12);
      ASSERT_LT(ray.Distance(virtual_camera.center_in_camera), 1e-9);
    }
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
  CameraConfig layered = PaperLens();
  layered.port = RandomLayeredPort(&rng);
  ASSERT_TRUE(AnyCamera::Create(layered));
  refused(with(layered, [](auto& c) { c.port.outer_layers[1].thickness_m = -1e-9; }), "layers");
  refused(with(layered, [&](auto& c) { c.port.outer_layers[0].index = nan; }), "layers");
  refused(with(layered, [](auto& c) { c.port.outer_layers[2].index = 0.9; }), "layers");
  refused(with(dome, [](auto& c) { c.port.outer_layers = {{0.01, 1.5}}; }), "layers");
  refused(with(dome, [](auto& c) { c.port.radius_m = 0.0; }), "radius_m");
  refused(with(dome, [](auto& c) { c.port.center_m = Vec3(0, 0, 0.2); }), "center_m");
  refused(with(dome, [&](auto& c) { c.port.center_m.y() = nan; }), "center_m");
}

}  // namespace
}  // namespace rsfm

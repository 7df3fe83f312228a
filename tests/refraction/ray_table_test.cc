// The ray table: its stated error holds everywhere, its statuses are the camera's, and it stays
// within its memory.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

#include "rsfm/refraction/ray_table.h"
#include "tests/support/malloc_trap.h"
#include "tests/support/rigs.h"

namespace rsfm {
namespace {

CameraConfig Lens(LensModel model, std::initializer_list<double> distortion) {
  CameraConfig config = PaperLens();
  config.lens = model;
  for (const double value : distortion) config.lens_params.TryPushBack(value);
  return config;
}

TEST(RayTable, StatedErrorHoldsForEveryPixel) {
  Rng rng(71);
  for (const RigKind kind : {RigKind::kFlat, RigKind::kDome, RigKind::kLayered}) {
    CameraConfig config = Lens(LensModel::kOpenCV, {-0.1, 0.02, 1e-4, -2e-4});
    config.port = RandomRig(kind, &rng).config().port;
    const AnyCamera camera = *AnyCamera::Create(config);
    const auto table = RayTable::Create(camera);
    ASSERT_TRUE(table) << table.error().where;
    EXPECT_EQ(table->num_exact_cells(), 0);
    EXPECT_GT(table->max_error_px(), 0.0);
    EXPECT_LE(table->max_error_px(), 1e-4);
    EXPECT_LE(table->Bytes(), RayTableOptions().max_bytes);
    double worst = 0.0;
    const auto check = [&](const Ray3& ray, const Vec2& pixel) {
      for (const double range : {0.5, 3.0, 1e4}) {
        Vec2 seen;
        ASSERT_EQ(camera.Project(ray.At(range), &seen), Projection::kOk);
        worst = std::max(worst, (seen - pixel).norm());
      }
      EXPECT_NEAR(ray.direction.norm(), 1.0, 1e-7);
    };
    for (int i = 0; i < 3000; ++i) {
      const Vec2 pixel(rng.Uniform(0, 1920), rng.Uniform(0, 1080));
      Ray3 ray;
      ASSERT_EQ(table->Lookup(pixel, &ray), Projection::kOk);
      check(ray, pixel);
    }
    std::vector<Ray3> rays(1000);
    std::vector<Projection> statuses(1000);
    for (const int row : {0, 7, 539, 1079}) {
      for (const int first : {0, 5, 920}) {
        table->LookupRow(row, first, rays, statuses);
        for (int i = 0; i < 1000; i += 7) {
          ASSERT_EQ(statuses[i], Projection::kOk);
          check(rays[i], Vec2(first + i + 0.5, row + 0.5));
        }
      }
    }
    EXPECT_LT(worst, 1.2 * table->max_error_px());
  }
}

TEST(RayTable, WhatCannotBeInterpolatedIsExact) {
  // The division model's fold lies within this image.
  CameraConfig config = Lens(LensModel::kSimpleDivision, {});
  config.lens_params = {1000.0, 960.0, 540.0, 1.1};
  Rng rng(72);
  config.port = RandomFlatPort(&rng);
  const AnyCamera camera = *AnyCamera::Create(config);
  const auto table = RayTable::Create(camera);
  ASSERT_TRUE(table);
  EXPECT_GT(table->num_exact_cells(), 0);
  EXPECT_LT(table->num_exact_cells(), table->num_cells());
  int failed = 0;
  std::vector<Ray3> rays(1920);
  std::vector<Projection> statuses(1920);
  for (int row = 0; row < 1080; row += 77) {
    table->LookupRow(row, 0, rays, statuses);
    for (int x = 0; x < 1920; ++x) {
      Ray3 exact, single;
      const Vec2 pixel(x + 0.5, row + 0.5);
      const Projection status = camera.Backproject(pixel, &exact);
      ASSERT_EQ(statuses[x], status) << x << " " << row;
      ASSERT_EQ(table->Lookup(pixel, &single), status);
      failed += status != Projection::kOk;
      if (status != Projection::kOk) continue;
      ASSERT_LT((rays[x].direction - exact.direction).norm(), 1e-6);
      ASSERT_LT((rays[x].direction - single.direction).norm(), 1e-12);
      ASSERT_LT((rays[x].origin - single.origin).norm(), 1e-12);
    }
  }
  EXPECT_GT(failed, 100);
}

TEST(RayTable, RefusesBadOptionsAndTooLittleMemory) {
  Rng rng(73);
  const AnyCamera camera = RandomRig(RigKind::kFlat, &rng);
  const auto refused = [&](const RayTableOptions& options, const char* where, Errc code) {
    const auto table = RayTable::Create(camera, options);
    ASSERT_FALSE(table);
    EXPECT_EQ(table.error().code, code);
    EXPECT_STREQ(table.error().where, where);
  };
  refused({.step_px = 1}, "step_px", Errc::kInvalidArgument);
  refused({.step_px = 65}, "step_px", Errc::kInvalidArgument);
  refused({.max_error_px = 0.0}, "max_error_px", Errc::kInvalidArgument);
  refused({.max_error_px = std::nan("")}, "max_error_px", Errc::kInvalidArgument);
  refused({.nearest_range_m = -1.0}, "nearest_range_m", Errc::kInvalidArgument);
  refused({.max_bytes = 1000}, "max_bytes", Errc::kOutOfCapacity);
}

TEST(RayTable, LookUpsOutsideTheImageAreStatusesAndNothingAllocates) {
  Rng rng(74);
  const auto table = RayTable::Create(RandomRig(RigKind::kDome, &rng), {.step_px = 32});
  ASSERT_TRUE(table);
  Ray3 ray{Vec3(5, 5, 5), Vec3(5, 5, 5)};
  const double nan = std::nan(""), inf = std::numeric_limits<double>::infinity();
  EXPECT_EQ(table->Lookup(Vec2(-0.01, 5), &ray), Projection::kOutsideImage);
  EXPECT_EQ(table->Lookup(Vec2(1920.01, 5), &ray), Projection::kOutsideImage);
  EXPECT_EQ(table->Lookup(Vec2(5, 1e300), &ray), Projection::kOutsideImage);
  EXPECT_EQ(table->Lookup(Vec2(nan, 5), &ray), Projection::kNotFinite);
  EXPECT_EQ(table->Lookup(Vec2(inf, 5), &ray), Projection::kNotFinite);
  EXPECT_EQ(ray.origin, Vec3(5, 5, 5));
  const std::vector<Vec2> pixels(100, Vec2(1920, 1080));
  std::vector<Ray3> rays(100);
  std::vector<Projection> statuses(100);
  MallocTrap trap;
  table->Lookup(pixels, rays, statuses);
  table->LookupRow(1079, 1820, rays, statuses);
  EXPECT_EQ(trap.count(), 0u);
  for (const Projection status : statuses) EXPECT_EQ(status, Projection::kOk);
}

}  // namespace
}  // namespace rsfm

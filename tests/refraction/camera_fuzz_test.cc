// Any finite input, for every lens behind every port: no NaN, no hang, outputs untouched on
// failure, statuses as a slow and obvious reference has them.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "rsfm/refraction/any_camera.h"
#include "rsfm/refraction/best_fit.h"
#include "rsfm/refraction/virtual_camera.h"
#include "tests/support/malloc_trap.h"
#include "tests/support/rigs.h"
#include "tests/support/traced_ray.h"

namespace rsfm {
namespace {

enum class Kind { kNone, kFlat, kLayered, kDome };

double Length(Rng* rng) {
  return rng->Index(4) == 0 ? 0.0 : std::pow(10.0, rng->Uniform(-12.0, 1.0));
}
double Index(Rng* rng) { return rng->Index(3) == 0 ? 1.0 : rng->Uniform(1.0, 4.0); }

PortConfig FuzzedPort(Kind kind, Rng* rng) {
  PortConfig port;
  if (kind == Kind::kNone) return port;
  port.type = kind == Kind::kDome ? PortType::kDome : PortType::kFlat;
  port.normal =
      Vec3(rng->Gaussian(), rng->Gaussian(), 0.05 + std::abs(rng->Gaussian())).normalized();
  port.distance_m = Length(rng);
  port.thickness_m = Length(rng);
  port.index_air = rng->Index(2) == 0 ? 1.0 : Index(rng);
  port.index_glass = Index(rng);
  port.index_water = Index(rng);
  port.radius_m = std::pow(10.0, rng->Uniform(-3.0, 1.0));
  port.center_m = rng->Uniform(0.0, 0.999) * port.radius_m *
                  Vec3(rng->Gaussian(), rng->Gaussian(), rng->Gaussian()).normalized();
  if (kind != Kind::kLayered) return port;
  for (int layers = 1 + static_cast<int>(rng->Index(3)); layers > 0; --layers)
    port.outer_layers.TryPushBack({Length(rng), Index(rng)});
  return port;
}

// How far from the axis a path of the Snell invariant s gets, in plain arithmetic.
long double Reach(const PortConfig& port, double height, long double s) {
  std::vector<std::pair<long double, long double>> layers{{port.distance_m, port.index_air},
                                                          {port.thickness_m, port.index_glass}};
  long double water = static_cast<long double>(height) - port.distance_m - port.thickness_m;
  for (const PortLayer& layer : port.outer_layers) {
    layers.push_back({layer.thickness_m, layer.index});
    water -= layer.thickness_m;
  }
  layers.push_back({water, port.index_water});
  long double sum = 0.0;
  for (const auto& [length, index] : layers) {
    if (length > 0.0L) sum += length * s / std::sqrt((index - s) * (index + s));
  }
  return sum;
}

TEST(CameraFuzz, EveryLensBehindEveryPortTakesAnyInput) {
  Rng rng(81);
  const double scales[] = {0.0, 1e-300, 1e-30, 1e-6, 1e-2, 1.0, 1.0, 1e2, 1e6, 1e200};
  int cameras = 0, projected = 0, backprojected = 0;
  for (const LensModel model : AllLensModels()) {
    for (const Kind kind : {Kind::kNone, Kind::kFlat, Kind::kLayered, Kind::kDome}) {
      for (int i = 0; i < 150; ++i) {
        CameraConfig config = PaperLens();
        config.lens = model;
        config.lens_params.TryResize(NumLensParams(model));
        const int focals = NumFocalLengths(model);
        for (int k = 0; k < NumLensParams(model); ++k) {
          config.lens_params[k] = k < focals       ? std::pow(10.0, rng.Uniform(1.0, 4.0))
                                  : k < focals + 2 ? rng.Uniform(-2000.0, 4000.0)
                                                   : (i % 3 == 0 ? scales[rng.Index(10)] : 0.1) *
                                                         rng.Uniform(-1.0, 1.0);
        }
        config.port = FuzzedPort(kind, &rng);
        MallocTrap trap;
        const auto camera = AnyCamera::Create(config);
        if (!camera) continue;
        ++cameras;
        const auto number = [&] { return scales[rng.Index(10)] * rng.Uniform(-1.0, 1.0); };
        for (int k = 0; k < 10; ++k) {
          const Vec3 point(number(), number(), k % 2 == 0 ? std::abs(number()) : number());
          const Vec2 untouched(-7.0, -7.0);
          Vec2 pixel = untouched, of_point = untouched, of_all = untouched;
          Mat23 d_pixel_d_point;
          CameraJacobian jacobian;
          const Projection status = camera->Project(point, &pixel);
          EXPECT_EQ(camera->Project(point, &of_point, &d_pixel_d_point), status)
              << ToString(model) << " port " << static_cast<int>(kind) << ", " << i << ": "
              << point.transpose();
          EXPECT_EQ(camera->Project(point, &of_all, &jacobian), status)
              << ToString(model) << " port " << static_cast<int>(kind) << ", " << i << ": "
              << point.transpose();
          if (status != Projection::kOk) {
            EXPECT_TRUE(pixel == untouched && of_point == untouched && of_all == untouched);
          } else if (i % 3 != 0) {  // coefficients of 1e200 may overflow, plausible ones not
            ++projected;
            EXPECT_FALSE(pixel.hasNaN()) << ToString(model) << " " << point.transpose();
          }
          const Vec2 at(960.0 + 1e3 * number(), 540.0 + 1e3 * number());
          const Ray3 before{Vec3(-7, -7, -7), Vec3(-7, -7, -7)};
          Ray3 ray = before, again = before;
          double range = 0.0;
          RayJacobian ray_jacobian;
          const Projection back = camera->Backproject(at, &ray);
          EXPECT_EQ(camera->Backproject(at, &again, &range), back);
          EXPECT_FALSE(std::isnan(range));
          VirtualCamera virtual_camera;
          if (ComputeVirtualCamera(*camera, at, &virtual_camera) == Projection::kOk) {
            EXPECT_TRUE(virtual_camera.center_in_camera.allFinite());
            EXPECT_LE(ray.RangeTo(virtual_camera.center_in_camera),
                      1e-9 * (1.0 + ray.origin.norm()));
          }
          if (back != Projection::kOk) {
            EXPECT_TRUE(ray.origin == before.origin && ray.direction == before.direction);
            continue;
          }
          ++backprojected;
          EXPECT_TRUE(ray.origin.allFinite() && ray.direction.allFinite());
          EXPECT_NEAR(ray.direction.norm(), 1.0, 1e-9);
          if (camera->Backproject(at, &again, &ray_jacobian) == Projection::kOk) {
            EXPECT_EQ(again.origin, ray.origin);
          }
        }
        const std::array<Vec2, 2> pixels{Vec2(3, 4), Vec2(1e9, -1e300)};
        std::array<Ray3, 2> rays;
        std::array<Projection, 2> statuses;
        camera->Backproject(pixels, rays, statuses);
        if (i % 10 == 0) (void)FitPerspective(*camera);
        EXPECT_EQ(trap.count(), 0u);
      }
    }
  }
  EXPECT_GT(cameras, 5000);
  EXPECT_GT(projected, 2000);
  EXPECT_GT(backprojected, 2000);
}

// A path through a flat port exists exactly where one of some invariant gets out to the point.
TEST(CameraFuzz, FlatStatusesAgreeWithTheReference) {
  Rng rng(82);
  int reflected = 0, seen = 0, most = 0;
  for (int i = 0; i < 100'000; ++i) {
    const PortConfig config = FuzzedPort(i % 2 == 0 ? Kind::kFlat : Kind::kLayered, &rng);
    const FlatPort port(config);
    const Vec3 point = std::pow(10.0, rng.Uniform(-3.0, 3.0)) *
                       Vec3(rng.Gaussian(), rng.Gaussian(), rng.Gaussian()).normalized();
    const double height = port.Axis().dot(point);
    double end = config.distance_m + config.thickness_m;
    double lowest = std::min({config.index_air, config.index_glass, config.index_water});
    for (const PortLayer& layer : config.outer_layers) {
      end += layer.thickness_m;
      lowest = std::min(lowest, layer.index);
    }
    Vec3 direction(9, 9, 9);
    const Projection status = port.RefractToAir(point, &direction);
    if (std::abs(height - end) < 1e-12 * (1.0 + end)) continue;
    if (height < end) {
      ASSERT_EQ(status,
                height > config.distance_m ? Projection::kInsideGlass : Projection::kBehindPort);
      continue;
    }
    most = std::max(most, port.CountSteps(point));
    const double r = (point - height * port.Axis()).norm();
    const long double limit =
        Reach(config, height, lowest);  // infinite along a layer of that index
    if (std::abs(static_cast<double>(limit) - r) < 1e-6 * r) continue;
    ASSERT_EQ(status, r < limit ? Projection::kOk : Projection::kTotalInternalReflection)
        << i << " r " << r << " limit " << static_cast<double>(limit);
    (status == Projection::kOk ? seen : reflected) += 1;
    if (status != Projection::kOk) continue;
    // The path found is the path: its invariant reaches r.
    const double sine = direction.cross(port.Axis()).norm();
    if (sine * config.index_air > 0.999 * lowest) continue;
    ASSERT_NEAR(static_cast<double>(Reach(config, height, config.index_air * sine)), r,
                1e-10 * (r + height))
        << i;
  }
  EXPECT_GT(seen, 10'000);
  EXPECT_GT(reflected, 1'000);
  EXPECT_LE(most, 12);  // docs/refraction.md states what was measured
  RecordProperty("most_evaluations", most);
}

// The way back against the plain trace, surface by surface.
TEST(CameraFuzz, BackwardStatusesAgreeWithTheReference) {
  Rng rng(83);
  int reflected = 0, seen = 0;
  for (int i = 0; i < 100'000; ++i) {
    const Kind kind = i % 3 == 0 ? Kind::kFlat : i % 3 == 1 ? Kind::kLayered : Kind::kDome;
    const PortConfig config = FuzzedPort(kind, &rng);
    const AnyPort port(config);
    const Vec3 air = Vec3(rng.Gaussian(), rng.Gaussian(), rng.Gaussian()).normalized();
    Vec3 origin, direction;
    const bool passes = TraceRay(PortNumbers<double>(config), air, &origin, &direction);
    Ray3 ray;
    const Projection status = port.RefractToWater(air, &ray);
    const bool behind = kind != Kind::kDome && config.normal.dot(air) <= 0.0;
    const Projection expected = passes   ? Projection::kOk
                                : behind ? Projection::kBehindPort
                                         : Projection::kTotalInternalReflection;
    if (status != expected) {  // right at a critical angle, rounding decides
      const Vec3 nudge = 1e-9 * air.unitOrthogonal();
      const PortNumbers<double> numbers(config);
      Vec3 o, d;
      const bool one = TraceRay(numbers, Vec3((air + nudge).normalized()), &o, &d);
      const bool other = TraceRay(numbers, Vec3((air - nudge).normalized()), &o, &d);
      ASSERT_NE(one, other) << i;
      continue;
    }
    (passes ? seen : reflected) += 1;
    if (!passes) continue;
    const Vec3 normal =
        kind == Kind::kDome ? Vec3((origin - config.center_m).normalized()) : port.Axis();
    if (normal.dot(direction) < 1e-2) continue;  // grazing: ill-conditioned
    ASSERT_LT((ray.direction - direction).norm(), 1e-9) << i;
    ASSERT_LT((Vec3(ray.origin - origin).cross(direction)).norm(), 1e-6 * (1e-9 + origin.norm()))
        << i;
  }
  EXPECT_GT(seen, 10'000);
  EXPECT_GT(reflected, 1'000);
}

TEST(LayeredPort, AGapOfAirReflectsWhatComesFromDenserMedia) {
  // A camera in oil looks through glass, a gap of air and glass: beyond asin(1 / 1.4) all is
  // reflected at the gap, though oil and glass alone would pass it.
  PortConfig port = CentredDomePort();
  port.type = PortType::kFlat;
  port.distance_m = 0.02;
  port.index_air = 1.4;
  Ray3 ray{Vec3(5, 5, 5), Vec3(5, 5, 5)};
  const double critical = std::asin(1.0 / 1.4);
  const auto at = [](double angle) { return Vec3(std::sin(angle), 0.0, std::cos(angle)); };
  EXPECT_EQ(FlatPort(port).RefractToWater(at(critical + 1e-3), &ray), Projection::kOk);
  port.outer_layers = {{0.003, 1.0}, {0.01, 1.52}};
  ray.origin.setConstant(5.0);
  EXPECT_EQ(FlatPort(port).RefractToWater(at(critical - 1e-9), &ray), Projection::kOk);
  ray.origin.setConstant(5.0);
  EXPECT_EQ(FlatPort(port).RefractToWater(at(critical + 1e-9), &ray),
            Projection::kTotalInternalReflection);
  EXPECT_EQ(ray.origin, Vec3(5, 5, 5));
  // The other way round a path along the gap leads to every point of the water.
  Vec3 direction;
  EXPECT_EQ(FlatPort(port).RefractToAir(Vec3(100.0, 0.0, 1.0), &direction), Projection::kOk);
  EXPECT_LT(std::asin(direction.x()), critical);
  // A gap without thickness lets none of them through that it would have reflected.
  port.outer_layers[0].thickness_m = 0.0;
  EXPECT_EQ(FlatPort(port).RefractToAir(Vec3(100.0, 0.0, 1.0), &direction),
            Projection::kTotalInternalReflection);
}

// Layers of one glass are one layer; one without thickness is none.
TEST(LayeredPort, LayersAddUp) {
  Rng rng(84);
  for (int i = 0; i < 200; ++i) {
    const PortConfig single = RandomFlatPort(&rng);
    PortConfig split = single;
    split.thickness_m = 0.25 * single.thickness_m;
    split.outer_layers = {{0.5 * single.thickness_m, single.index_glass},
                          {0.0, 1.4},
                          {0.25 * single.thickness_m, single.index_glass}};
    CameraConfig config = PaperLens();
    config.port = single;
    const AnyCamera one = *AnyCamera::Create(config);
    config.port = split;
    const AnyCamera four = *AnyCamera::Create(config);
    const Vec2 pixel(rng.Uniform(0, 1920), rng.Uniform(0, 1080));
    Ray3 a, b;
    ASSERT_EQ(one.Backproject(pixel, &a), Projection::kOk);
    ASSERT_EQ(four.Backproject(pixel, &b), Projection::kOk);
    EXPECT_LT((a.origin - b.origin).norm() + (a.direction - b.direction).norm(), 1e-14);
    Vec2 pixel_a, pixel_b;
    CameraJacobian jacobian_a, jacobian_b;
    ASSERT_EQ(one.Project(a.At(2.0), &pixel_a, &jacobian_a), Projection::kOk);
    ASSERT_EQ(four.Project(a.At(2.0), &pixel_b, &jacobian_b), Projection::kOk);
    EXPECT_LT((pixel_a - pixel_b).norm(), 1e-9);
    EXPECT_LT((jacobian_a.d_pixel_d_point - jacobian_b.d_pixel_d_point).norm(), 1e-7);
    EXPECT_LT((jacobian_a.d_pixel_d_port.col(4) - jacobian_b.d_pixel_d_port.col(4)).norm(), 1e-6);
    EXPECT_LT((jacobian_a.d_pixel_d_port.col(6) - jacobian_b.d_pixel_d_port.col(6) -
               jacobian_b.d_pixel_d_layers.col(1) - jacobian_b.d_pixel_d_layers.col(5))
                  .norm(),
              1e-6);
  }
}

}  // namespace
}  // namespace rsfm

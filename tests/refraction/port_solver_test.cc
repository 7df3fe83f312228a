// The path solvers themselves: their bound on steps, their statuses against a slow and obvious
// reference, and any input.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "rsfm/refraction/dome_port.h"
#include "rsfm/refraction/flat_port.h"
#include "tests/support/rigs.h"

namespace rsfm {
namespace {

double LogUniform(Rng* rng, double low, double high) {
  return std::pow(10.0, rng->Uniform(low, high));
}

PortConfig WildFlat(Rng* rng) {
  PortConfig port;
  port.type = PortType::kFlat;
  port.normal =
      Vec3(rng->Gaussian(), rng->Gaussian(), 0.01 + std::abs(rng->Gaussian())).normalized();
  port.distance_m = rng->Index(4) == 0 ? 0.0 : LogUniform(rng, -15, 1);
  port.thickness_m = rng->Index(4) == 0 ? 0.0 : LogUniform(rng, -15, 1);
  port.index_air = rng->Index(2) ? 1.0 : rng->Uniform(1.0, 4.0);
  port.index_glass = rng->Uniform(1.0, 4.0);
  port.index_water = rng->Index(8) == 0 ? port.index_air : rng->Uniform(1.0, 4.0);
  return port;
}

PortConfig WildDome(Rng* rng) {
  PortConfig port = WildFlat(rng);
  port.type = PortType::kDome;
  port.radius_m = LogUniform(rng, -3, 1);
  const double eccentricity = rng->Index(8) == 0 ? 0.0 : std::min(LogUniform(rng, -15, 0), 0.999);
  port.center_m = eccentricity * port.radius_m *
                  Vec3(rng->Gaussian(), rng->Gaussian(), rng->Gaussian()).normalized();
  return port;
}

Vec3 WildPoint(Rng* rng) {
  return LogUniform(rng, -4, 4) *
         Vec3(rng->Gaussian(), rng->Gaussian(), rng->Gaussian()).normalized();
}

TEST(FlatPortSolver, StepsAreBoundedAndTheTracedRayMeetsThePoint) {
  Rng rng(31);
  int most = 0, solved = 0;
  for (int i = 0; i < 200'000; ++i) {
    const PortConfig config = WildFlat(&rng);
    const FlatPort port(config);
    const Vec3 point = WildPoint(&rng);
    Vec3 direction(9, 9, 9);
    if (port.RefractToAir(point, &direction) != Projection::kOk) {
      ASSERT_EQ(direction, Vec3(9, 9, 9));
      continue;
    }
    ++solved;
    most = std::max(most, port.CountSteps(point));
    ASSERT_NEAR(direction.norm(), 1.0, 1e-12);
    // Grazing rays are ill-conditioned the way back: judge where the ray is well defined.
    const double sine_in_glass =
        config.index_air / config.index_glass * direction.cross(port.Axis()).norm();
    if (direction.dot(port.Axis()) < 1e-3 || sine_in_glass > 0.999) continue;
    Ray3 ray;
    const Projection back = port.RefractToWater(direction, &ray);
    if (back != Projection::kOk || ray.direction.dot(port.Axis()) < 1e-3) continue;
    ASSERT_LT(ray.Distance(point), 1e-8 * (point - ray.origin).norm() + 1e-12) << i;
  }
  EXPECT_GT(solved, 50'000);
  EXPECT_LE(most, 16);  // of kMaxSteps; docs/refraction.md has what was measured
}

TEST(FlatPortSolver, UsualRigsTakeTwoSteps) {
  Rng rng(32);
  double sum = 0;
  int most = 0;
  const int n = 20'000;
  for (int i = 0; i < n; ++i) {
    const FlatPort port(RandomFlatPort(&rng));
    Ray3 ray;
    ASSERT_EQ(port.RefractToWater(
                  Vec3(rng.Uniform(-0.74, 0.74), rng.Uniform(-0.42, 0.42), 1).normalized(), &ray),
              Projection::kOk);
    const int steps = port.CountSteps(ray.At(rng.Uniform(0.5, 10.0)));
    sum += steps;
    most = std::max(most, steps);
  }
  EXPECT_LT(sum / n, 2.2);
  EXPECT_LE(most, 3);
}

TEST(DomePortSolver, StepsAreBoundedAndTheTracedRayMeetsThePoint) {
  Rng rng(33);
  int most = 0, solved = 0;
  for (int i = 0; i < 200'000; ++i) {
    const DomePort port(WildDome(&rng));
    const Vec3 point = WildPoint(&rng);
    Vec3 direction(9, 9, 9);
    if (port.RefractToAir(point, &direction) != Projection::kOk) {
      ASSERT_EQ(direction, Vec3(9, 9, 9));
      continue;
    }
    ++solved;
    most = std::max(most, port.CountSteps(point));
    ASSERT_NEAR(direction.norm(), 1.0, 1e-12);
    Ray3 ray;
    const Projection back = port.RefractToWater(direction, &ray);
    if (back != Projection::kOk) continue;
    ASSERT_LT(ray.Distance(point), 1e-7 * (point - ray.origin).norm() + 1e-9) << i;
  }
  EXPECT_GT(solved, 50'000);
  EXPECT_LE(most,
            75);  // of kMaxFastSteps + kMaxBracketSteps; docs/refraction.md has what was measured
}

TEST(DomePortSolver, UsualRigsTakeTwoSteps) {
  Rng rng(34);
  double sum = 0;
  int most = 0;
  const int n = 20'000;
  for (int i = 0; i < n; ++i) {
    const DomePort port(RandomDomePort(&rng));
    Ray3 ray;
    ASSERT_EQ(port.RefractToWater(
                  Vec3(rng.Uniform(-0.74, 0.74), rng.Uniform(-0.42, 0.42), 1).normalized(), &ray),
              Projection::kOk);
    const int steps = port.CountSteps(ray.At(rng.Uniform(0.5, 10.0)));
    sum += steps;
    most = std::max(most, steps);
  }
  EXPECT_LT(sum / n, 2.2);
  EXPECT_LE(most, 3);
}

// With air the thinnest medium, every point of the water is seen; the reference says so by geometry
// alone.
TEST(PortSolver, StatusesAgreeWithGeometry) {
  Rng rng(35);
  for (int i = 0; i < 100'000; ++i) {
    PortConfig flat = WildFlat(&rng), dome = WildDome(&rng);
    flat.index_air = dome.index_air = 1.0;
    flat.distance_m = std::max(flat.distance_m, 1e-6);
    const Vec3 point = WildPoint(&rng);
    Vec3 direction;
    const double height = flat.normal.dot(point);
    const Projection flat_expected = height - flat.distance_m - flat.thickness_m > 0
                                         ? Projection::kOk
                                     : height - flat.distance_m > 0 ? Projection::kInsideGlass
                                                                    : Projection::kBehindPort;
    ASSERT_EQ(FlatPort(flat).RefractToAir(point, &direction), flat_expected) << i;
    const double range = (point - dome.center_m).norm();
    const Projection dome_expected = range > dome.radius_m + dome.thickness_m ? Projection::kOk
                                     : range > dome.radius_m ? Projection::kInsideGlass
                                                             : Projection::kBehindPort;
    ASSERT_EQ(DomePort(dome).RefractToAir(point, &direction), dome_expected)
        << i << " e/r " << dome.center_m.norm() / dome.radius_m;
  }
}

TEST(FlatPortSolver, BeyondTheCriticalAngleIsTotalReflection) {
  // Lens on the glass (no air): directions in water beyond asin(1 / 1.334) never enter.
  PortConfig port = CentredDomePort();
  port.type = PortType::kFlat;
  port.distance_m = 0.0;
  port.thickness_m = 0.0;
  const double critical = std::asin(1.0 / 1.334);
  Vec3 direction;
  const FlatPort flat(port);
  EXPECT_EQ(
      flat.RefractToAir(Vec3(std::sin(critical - 1e-6), 0, std::cos(critical - 1e-6)), &direction),
      Projection::kOk);
  EXPECT_EQ(
      flat.RefractToAir(Vec3(std::sin(critical + 1e-6), 0, std::cos(critical + 1e-6)), &direction),
      Projection::kTotalInternalReflection);
  // And from dense to thin the other way round.
  port.index_air = 1.6;
  port.index_water = 1.0;
  Ray3 ray;
  EXPECT_EQ(FlatPort(port).RefractToWater(Vec3(0.8, 0, 0.6), &ray),
            Projection::kTotalInternalReflection);
  EXPECT_EQ(FlatPort(port).RefractToWater(Vec3(0.3, 0, std::sqrt(0.91)), &ray), Projection::kOk);
  EXPECT_EQ(FlatPort(port).RefractToWater(Vec3(0.0, 0, -1.0), &ray), Projection::kBehindPort);
}

TEST(PortSolver, NonFiniteInputIsAStatus) {
  Rng rng(36);
  const FlatPort flat(RandomFlatPort(&rng));
  const DomePort dome(RandomDomePort(&rng));
  Vec3 direction;
  for (const double bad : {double{NAN}, double{INFINITY}, -double{INFINITY}, 1e300}) {
    for (int k = 0; k < 3; ++k) {
      Vec3 point(0.1, 0.2, 3.0);
      point[k] = bad;
      EXPECT_EQ(flat.RefractToAir(point, &direction), Projection::kNotFinite);
      EXPECT_EQ(dome.RefractToAir(point, &direction), Projection::kNotFinite);
    }
  }
}

}  // namespace
}  // namespace rsfm

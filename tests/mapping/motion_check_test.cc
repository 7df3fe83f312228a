#include "rsfm/mapping/motion_check.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <vector>

#include "tests/support/malloc_trap.h"

namespace rsfm {
namespace {

// What a camera of focal length 800 px sees of a rough seabed before and after it has moved: a
// point 2 to 4 m away.
struct Seabed {
  Rng rng{7};
  Vec3 Point() { return {rng.Uniform(-2.0, 2.0), rng.Uniform(-1.5, 1.5), rng.Uniform(2.0, 4.0)}; }
};

PatchPlace Project(const Vec3& point) {
  return {static_cast<float>(640.0 + 800.0 * point.x() / point.z()),
          static_cast<float>(480.0 + 800.0 * point.y() / point.z())};
}

TrackedPoint Follow(const Vec3& at_keyframe, const Vec3& before, const Vec3& now, double noise_px,
                    Rng* rng) {
  TrackedPoint point;
  point.at_keyframe = Project(at_keyframe);
  point.before = Project(before);
  point.place = Project(now);
  point.place.x += static_cast<float>(rng->Uniform(-noise_px, noise_px));
  point.place.y += static_cast<float>(rng->Uniform(-noise_px, noise_px));
  point.age = 3;
  return point;
}

using Motion = std::function<Vec3(const Vec3&, double)>;  // a point after that part of the way

std::vector<TrackedPoint> Scene(int count, const Motion& move) {
  Seabed seabed;
  std::vector<TrackedPoint> points;
  while (static_cast<int>(points.size()) < count) {
    const Vec3 point = seabed.Point();
    points.push_back(Follow(point, move(point, 0.75), move(point, 1.0), 0.3, &seabed.rng));
  }
  return points;
}

Vec3 Forward(const Vec3& p, double part) { return p - part * Vec3(0.05, 0.1, 0.0); }
Vec3 Approach(const Vec3& p, double part) { return p - part * Vec3(0.0, 0.0, 0.3); }
Vec3 TurnInPlace(const Vec3& p, double part) {
  return Eigen::AngleAxisd(0.1 * part, Vec3::UnitZ()) * p;
}

int CountOf(std::span<const PointVerdict> verdicts, PointVerdict verdict) {
  return static_cast<int>(std::count(verdicts.begin(), verdicts.end(), verdict));
}

TEST(MotionCheck, ASceneIsLeftAlone) {
  for (const Motion& move : {Motion(Forward), Motion(Approach), Motion(TurnInPlace),
                             Motion([](const Vec3&p, double) { return p; })}) {
    const std::vector<TrackedPoint> points = Scene(300, move);
    std::vector<PointVerdict> verdicts(points.size());
    MotionCheck check(400);
    check.Judge(points, 1, verdicts);
    EXPECT_GE(CountOf(verdicts, PointVerdict::kScene), 298);
  }
}

// A field of particles on the port, 30 px wide, and a line of burnt-in text.
TEST(MotionCheck, WhatIsFixedToTheCameraIsFound) {
  std::vector<TrackedPoint> points = Scene(200, Forward);
  Rng rng(3);
  for (int i = 0; i < 60; ++i) {
    TrackedPoint point;
    point.place = i < 40 ? PatchPlace{static_cast<float>(rng.Uniform(600.0, 630.0)),
                                      static_cast<float>(rng.Uniform(300.0, 330.0))}
                         : PatchPlace{static_cast<float>(20 + 12 * (i - 40)), 940.0f};
    point.before = point.at_keyframe = point.place;
    point.place.x += static_cast<float>(rng.Uniform(-0.2, 0.2));
    point.age = 3;
    points.push_back(point);
  }
  std::vector<PointVerdict> verdicts(points.size());
  MotionCheck check(400);
  check.Judge(points, 1, verdicts);
  EXPECT_EQ(CountOf(std::span(verdicts).last(60), PointVerdict::kStationary), 60);
  EXPECT_EQ(CountOf(std::span(verdicts).first(200), PointVerdict::kStationary), 0);
}

// Snow: every flake goes its own way.
TEST(MotionCheck, DriftingParticlesAreFound) {
  std::vector<TrackedPoint> points = Scene(200, Forward);
  Rng rng(4);
  for (int i = 0; i < 60; ++i) {
    TrackedPoint point;
    point.before = {static_cast<float>(rng.Uniform(0.0, 1280.0)),
                    static_cast<float>(rng.Uniform(0.0, 960.0))};
    const double angle = rng.Uniform(0.0, 6.2832), step = rng.Uniform(15.0, 30.0);
    point.place = {point.before.x + static_cast<float>(step * std::cos(angle)),
                   point.before.y + static_cast<float>(step * std::sin(angle))};
    point.at_keyframe = point.before;
    point.age = 1;
    points.push_back(point);
  }
  std::vector<PointVerdict> verdicts(points.size());
  MotionCheck check(400);
  check.Judge(points, 1, verdicts);
  EXPECT_GE(CountOf(std::span(verdicts).last(60), PointVerdict::kDrifting),
            48);  // not along the line
  EXPECT_LE(CountOf(std::span(verdicts).first(200), PointVerdict::kDrifting), 2);
}

// A vehicle that hovers while snow drifts past on the current: the scene is not what moves.
TEST(MotionCheck, AHoveringCameraLosesNothing) {
  std::vector<TrackedPoint> points = Scene(200, [](const Vec3& p, double) { return p; });
  std::vector<TrackedPoint> snow = Scene(90, Forward);
  points.insert(points.end(), snow.begin(), snow.end());
  std::vector<PointVerdict> verdicts(points.size());
  MotionCheck check(400);
  check.Judge(points, 1, verdicts);
  EXPECT_GE(CountOf(std::span(verdicts).first(200), PointVerdict::kScene), 198);
}

TEST(MotionCheck, FewPointsAndSameSeedSameAnswer) {
  const std::vector<TrackedPoint> few = Scene(10, Forward);
  std::vector<PointVerdict> verdicts(few.size(), PointVerdict::kDrifting);
  MotionCheck check(400);
  check.Judge(few, 1, verdicts);
  EXPECT_EQ(CountOf(verdicts, PointVerdict::kScene), 10);

  const std::vector<TrackedPoint> points = Scene(300, Forward);
  std::vector<PointVerdict> first(points.size()), second(points.size());
  const MallocTrap trap;
  check.Judge(points, 5, first);
  check.Judge(points, 5, second);
  EXPECT_EQ(trap.count(), 0u);
  EXPECT_EQ(first, second);
}

}  // namespace
}  // namespace rsfm

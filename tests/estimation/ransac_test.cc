// LO-RANSAC on a problem that can be checked by hand: a line through points of the plane.
#include "rsfm/estimation/ransac.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <vector>

#include "rsfm/base/linear.h"
#include "rsfm/base/static_vector.h"
#include "tests/support/malloc_trap.h"

namespace rsfm {
namespace {

// y = slope x + intercept.
class LineProblem {
 public:
  static constexpr int kSampleSize = 2;
  using Model = Vec2;  // slope, intercept
  using Models = StaticVector<Vec2, 1>;

  explicit LineProblem(std::span<const Vec2> points) : points_(points) {}
  int Size() const { return static_cast<int>(points_.size()); }
  void Solve(std::span<const int, 2> sample, Models* models) const {
    const Vec2 between = points_[sample[1]] - points_[sample[0]];
    if (std::abs(between.x()) < 1e-9) return;
    const double slope = between.y() / between.x();
    models->TryPushBack({slope, points_[sample[0]].y() - slope * points_[sample[0]].x()});
  }
  double SquaredError(const Vec2& line, int i) const {
    const double error = points_[i].y() - line.x() * points_[i].x() - line.y();
    return error * error;
  }
  bool Refine(std::span<const int> inliers, Vec2* line) const {
    Mat2 matrix = Mat2::Zero();
    Vec2 right_side = Vec2::Zero();
    for (const int i : inliers) {
      const Vec2 row(points_[i].x(), 1.0);
      matrix += row * row.transpose();
      right_side += row * points_[i].y();
    }
    const double determinant = matrix(0, 0) * matrix(1, 1) - matrix(0, 1) * matrix(1, 0);
    if (std::abs(determinant) < 1e-12) return false;
    *line = Vec2(matrix(1, 1) * right_side.x() - matrix(0, 1) * right_side.y(),
                 matrix(0, 0) * right_side.y() - matrix(1, 0) * right_side.x()) /
            determinant;
    return true;
  }

 private:
  std::span<const Vec2> points_;
};

std::vector<Vec2> NoisyLine(int count, double outlier_ratio, double noise, std::uint64_t seed) {
  Rng rng(seed);
  std::vector<Vec2> points;
  for (int i = 0; i < count; ++i) {
    const double x = rng.Uniform(-10.0, 10.0);
    const bool is_outlier = i < outlier_ratio * count;
    points.emplace_back(
        x, is_outlier ? rng.Uniform(-50.0, 50.0) : 2.0 * x - 3.0 + rng.Gaussian(0.0, noise));
  }
  return points;
}

RansacOptions Options() {
  RansacOptions options;
  options.max_error_px = 0.5;
  return options;
}

TEST(Ransac, FindsTheLineAndMarksItsInliers) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    const std::vector<Vec2> points = NoisyLine(200, 0.5, 0.1, seed);
    LineProblem problem(points);
    RansacWorkspace workspace(200);
    Vec2 line;
    RansacOptions options = Options();
    options.seed = seed;
    const auto report = Ransac(problem, options, &workspace, &line);
    ASSERT_TRUE(report);
    EXPECT_NEAR(line.x(), 2.0, 0.03);
    EXPECT_NEAR(line.y(), -3.0, 0.15);
    EXPECT_GE(report->num_inliers, 98);
    int marked = 0;
    double score = 0.0;
    for (int i = 0; i < 200; ++i) {
      const double squared_error = problem.SquaredError(line, i);
      EXPECT_EQ(workspace.mask[i] == 1, squared_error < 0.25);
      marked += workspace.mask[i];
      score += std::min(squared_error, 0.25);
    }
    EXPECT_EQ(marked, report->num_inliers);
    EXPECT_NEAR(score, report->score, 1e-9);
    EXPECT_LT(report->iterations, 100);
  }
}

TEST(Ransac, LocalOptimisationImprovesTheScore) {
  double with = 0.0, without = 0.0;
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    const std::vector<Vec2> points = NoisyLine(100, 0.3, 0.2, seed);
    LineProblem problem(points);
    RansacWorkspace workspace(100);
    Vec2 line;
    RansacOptions options = Options();
    with += Ransac(problem, options, &workspace, &line)->score;
    options.max_refinements = 0;
    without += Ransac(problem, options, &workspace, &line)->score;
  }
  EXPECT_LT(with, without);
}

TEST(Ransac, RepeatsBitForBitWithTheSameSeed) {
  const std::vector<Vec2> points = NoisyLine(100, 0.4, 0.2, 3);
  LineProblem problem(points);
  RansacWorkspace first(100), second(150);
  Vec2 line_1, line_2;
  const auto report_1 = Ransac(problem, Options(), &first, &line_1);
  const auto report_2 = Ransac(problem, Options(), &second, &line_2);
  ASSERT_TRUE(report_1 && report_2);
  EXPECT_EQ(line_1, line_2);
  EXPECT_EQ(report_1->evaluations, report_2->evaluations);
}

// 100 points all over: no line has more than a few of them.
std::vector<Vec2> PointsWithoutALine() {
  Rng rng(4);
  std::vector<Vec2> points;
  for (int i = 0; i < 100; ++i) {
    const double x = rng.Uniform(-10, 10);
    points.emplace_back(x, rng.Uniform(-1e4, 1e4));
  }
  return points;
}

TEST(Ransac, KeepsItsBounds) {
  const std::vector<Vec2> points = PointsWithoutALine();
  LineProblem problem(points);
  RansacWorkspace workspace(100);
  Vec2 line;
  RansacOptions options = Options();
  options.max_iterations = 37;
  const auto by_iterations = Ransac(problem, options, &workspace, &line);
  ASSERT_TRUE(by_iterations);
  EXPECT_EQ(by_iterations->iterations, 37);
  options.max_iterations = 100000;
  options.max_evaluations = 2000;
  const auto by_evaluations = Ransac(problem, options, &workspace, &line);
  ASSERT_TRUE(by_evaluations);
  EXPECT_LT(by_evaluations->evaluations, 2000 + 100 * (options.max_refinements + 1));
}

TEST(Ransac, StopsWhenAskedAndSaysWhy) {
  const std::vector<Vec2> points = PointsWithoutALine();
  LineProblem problem(points);
  RansacWorkspace workspace(100);
  Vec2 line;
  RansacOptions options = Options();
  options.max_iterations = 50;
  EXPECT_EQ(Ransac(problem, options, &workspace, &line)->end, RansacEnd::kMaxIterations);
  options.max_evaluations = 500;
  EXPECT_EQ(Ransac(problem, options, &workspace, &line)->end, RansacEnd::kMaxEvaluations);
  options.max_evaluations = 1'000'000;
  int budget = 7;
  options.stop_context = &budget;
  options.stop = [](void* context) { return --*static_cast<int*>(context) == 0; };
  const auto stopped = Ransac(problem, options, &workspace, &line);
  ASSERT_TRUE(stopped);
  EXPECT_EQ(stopped->end, RansacEnd::kStopped);
  EXPECT_EQ(stopped->iterations, 7);
  const std::vector<Vec2> good = NoisyLine(100, 0.2, 0.1, 3);
  LineProblem easy(good);
  options.stop = nullptr;
  EXPECT_EQ(Ransac(easy, options, &workspace, &line)->end, RansacEnd::kConfidence);
}

// Sorted so that the wrong ones come last, nine wrong ones among ten cost few samples.
TEST(Ransac, SortedObservationsNeedFewerSamples) {
  int sorted_samples = 0, plain_samples = 0;
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    std::vector<Vec2> points = NoisyLine(300, 0.9, 0.1, seed);
    std::reverse(points.begin(), points.end());  // NoisyLine's outliers come first
    LineProblem problem(points);
    RansacWorkspace workspace(300);
    Vec2 line;
    RansacOptions options = Options();
    options.seed = seed;
    options.max_iterations = 5000;
    const auto plain = Ransac(problem, options, &workspace, &line);
    ASSERT_TRUE(plain);
    plain_samples += plain->iterations;
    options.sorted_by_quality = true;
    const auto sorted = Ransac(problem, options, &workspace, &line);
    ASSERT_TRUE(sorted);
    sorted_samples += sorted->iterations;
    EXPECT_NEAR(line.x(), 2.0, 0.1) << seed;
    EXPECT_NEAR(sorted->inlier_ratio, sorted->num_inliers / 300.0, 1e-12);
  }
  EXPECT_LT(10 * sorted_samples, plain_samples);
}

// A wrong order costs time, not the result; every observation can be sampled in the end.
TEST(Ransac, AWrongOrderStillFindsTheLine) {
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    const std::vector<Vec2> points = NoisyLine(200, 0.6, 0.1, seed);  // outliers first
    LineProblem problem(points);
    RansacWorkspace workspace(200);
    Vec2 line;
    RansacOptions options = Options();
    options.seed = seed;
    options.sorted_by_quality = true;
    ASSERT_TRUE(Ransac(problem, options, &workspace, &line));
    EXPECT_NEAR(line.x(), 2.0, 0.1) << seed;
  }
}

// A threshold ten times too wide: the marginal loss minds it less than the truncated one.
TEST(Ransac, MarginalScoringMindsAWideThresholdLess) {
  double msac_error = 0.0, magsac_error = 0.0;
  for (std::uint64_t seed = 1; seed <= 100; ++seed) {
    const std::vector<Vec2> points = NoisyLine(200, 0.5, 0.1, seed);
    LineProblem problem(points);
    RansacWorkspace workspace(200);
    Vec2 line;
    RansacOptions options = Options();
    options.seed = seed;
    options.max_error_px = 5.0;
    options.max_refinements = 0;
    options.min_iterations = 300;
    ASSERT_TRUE(Ransac(problem, options, &workspace, &line));
    msac_error += std::abs(line.x() - 2.0);
    options.scoring = RansacScoring::kMagsac;
    ASSERT_TRUE(Ransac(problem, options, &workspace, &line));
    magsac_error += std::abs(line.x() - 2.0);
  }
  EXPECT_LT(magsac_error, msac_error);
}

TEST(MagsacLoss, RisesFromZeroToOne) {
  const auto check = [](const auto& loss) {
    EXPECT_NEAR(loss(0.0), 0.0, 1e-12);
    EXPECT_NEAR(loss(1.0), 1.0, 1e-12);
    double last = 0.0;
    for (int i = 1; i <= 1000; ++i) {
      const double value = loss(1e-3 * i);
      EXPECT_GE(value, last) << i;
      EXPECT_GE(value, 1e-3 * i - 1e-9) << i;  // bends down from the truncated square's line
      last = value;
    }
  };
  check(internal::MagsacLoss<1>::Get());
  check(internal::MagsacLoss<2>::Get());
}

TEST(Ransac, IgnoresObservationsThatAreNotFinite) {
  std::vector<Vec2> points = NoisyLine(100, 0.2, 0.1, 5);
  for (int i = 0; i < 10; ++i) points[i].y() = std::numeric_limits<double>::quiet_NaN();
  LineProblem problem(points);
  RansacWorkspace workspace(100);
  Vec2 line;
  ASSERT_TRUE(Ransac(problem, Options(), &workspace, &line));
  EXPECT_NEAR(line.x(), 2.0, 0.02);
  for (int i = 0; i < 10; ++i) EXPECT_EQ(workspace.mask[i], 0);
}

TEST(Ransac, NamesWhatIsWrong) {
  const std::vector<Vec2> points = NoisyLine(100, 0.2, 0.1, 6);
  RansacWorkspace workspace(50);
  Vec2 line(7.0, 7.0);
  LineProblem problem(points);
  EXPECT_EQ(Ransac(problem, Options(), &workspace, &line).error().code, Errc::kOutOfCapacity);
  LineProblem tiny({points.data(), 1});
  EXPECT_EQ(Ransac(tiny, Options(), &workspace, &line).error().code, Errc::kNotEnoughData);
  const std::vector<Vec2> same(20, Vec2(1.0, 2.0));
  LineProblem degenerate(same);
  EXPECT_EQ(Ransac(degenerate, Options(), &workspace, &line).error().code, Errc::kDegenerate);
  RansacOptions bad = Options();
  bad.max_error_px = std::numeric_limits<double>::quiet_NaN();
  LineProblem some({points.data(), 50});
  EXPECT_STREQ(Ransac(some, bad, &workspace, &line).error().where, "max_error_px");
  bad = Options();
  bad.confidence = 1.0;
  EXPECT_STREQ(Ransac(some, bad, &workspace, &line).error().where, "confidence");
  EXPECT_EQ(line, Vec2(7.0, 7.0));  // untouched
}

TEST(Ransac, DoesNotTouchTheHeap) {
  const std::vector<Vec2> points = NoisyLine(100, 0.4, 0.2, 7);
  LineProblem problem(points);
  RansacWorkspace workspace(100);
  Vec2 line;
  const MallocTrap trap;
  const auto report = Ransac(problem, Options(), &workspace, &line);
  EXPECT_EQ(trap.count(), 0u);
  EXPECT_TRUE(report);
}

TEST(Meaningful, SeparatesConsensusFromChance) {
  EXPECT_TRUE(IsMeaningful(140, 200, 3, 2e-4));
  EXPECT_TRUE(IsMeaningful(10, 200, 3, 2e-4));
  EXPECT_FALSE(IsMeaningful(4, 200, 3, 2e-4));
  EXPECT_FALSE(IsMeaningful(12, 200, 5, 0.01));
  EXPECT_TRUE(IsMeaningful(60, 200, 5, 0.01));
  EXPECT_FALSE(IsMeaningful(3, 3, 3, 1e-9));
}

}  // namespace
}  // namespace rsfm

// The evaluation of the solvers: repeatable, bounded from below, and saying what its contract says.
#include "tools/evaluation/solver_evaluation.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tools/report/solver_figures.h"

namespace rsfm {
namespace {

using ::testing::HasSubstr;
using ::testing::StartsWith;

SolverRequest Request(SolverFigure figure, SolverPort port) {
  SolverRequest request;
  request.figure = figure;
  request.port = port;
  request.noise_px = {0.0, 1.0};
  request.experiments = 4;
  return request;
}

bool GoOn(std::int64_t) { return true; }

void ExpectSameButForTimes(const SolverEvaluation& a, const SolverEvaluation& b) {
  ASSERT_EQ(a.rows.size(), b.rows.size());
  for (std::size_t i = 0; i < a.rows.size(); ++i) {
    EXPECT_EQ(a.rows[i].method, b.rows[i].method);
    EXPECT_EQ(a.rows[i].failures, b.rows[i].failures);
    EXPECT_EQ(a.rows[i].rotation_error_deg_mean, b.rows[i].rotation_error_deg_mean);
    EXPECT_EQ(a.rows[i].translation_error_mean, b.rows[i].translation_error_mean);
    EXPECT_EQ(a.rows[i].translation_error_std, b.rows[i].translation_error_std);
    EXPECT_EQ(a.rows[i].inlier_ratio_mean, b.rows[i].inlier_ratio_mean);
  }
  EXPECT_EQ(ToCsv(a.bounds), ToCsv(b.bounds));
}

TEST(SolverEvaluation, AbsoluteRepeatsOnAnyNumberOfThreadsAndNearsTheBound) {
  for (const SolverPort port : {SolverPort::kFlat, SolverPort::kDome, SolverPort::kCentredDome}) {
    SolverRequest request = Request(SolverFigure::kAbsolutePose, port);
    request.experiments = 30;
    const auto one = EvaluateSolvers(request, GoOn);
    request.threads = 3;
    const auto three = EvaluateSolvers(request, GoOn);
    ASSERT_TRUE(one && three);
    ExpectSameButForTimes(*one, *three);
    ASSERT_EQ(one->rows.size(), 6u);
    EXPECT_EQ(one->rows[2].method, "gp3p_refined");
    for (const SolverRow& row : one->rows) EXPECT_EQ(row.failures, 0);
    EXPECT_LT(one->rows[2].rotation_error_deg_mean, 1e-6);  // without noise
    EXPECT_EQ(one->bounds[0].rotation_error_deg, 0.0);
    const SolverBound& bound = one->bounds[1];
    EXPECT_GT(one->rows[5].rotation_error_deg_mean, 0.7 * bound.rotation_error_deg);
    EXPECT_LT(one->rows[5].rotation_error_deg_mean, 1.5 * bound.rotation_error_deg);
    EXPECT_GT(one->rows[5].translation_error_mean, 0.7 * bound.translation_error);
    EXPECT_LT(one->rows[5].translation_error_mean, 1.5 * bound.translation_error);
  }
}

TEST(SolverEvaluation, RelativeRepeatsAndOursLosesNothing) {
  const SolverRequest request = Request(SolverFigure::kRelativePose, SolverPort::kFlat);
  const auto first = EvaluateSolvers(request, GoOn);
  const auto second = EvaluateSolvers(request, GoOn);
  ASSERT_TRUE(first && second);
  ExpectSameButForTimes(*first, *second);
  ASSERT_EQ(first->rows.size(), 12u);
  const SolverRow& ours = first->rows[11];
  EXPECT_EQ(ours.method, "ours");
  EXPECT_EQ(ours.failures, 0);
  EXPECT_GE(ours.inlier_ratio_mean, first->bounds[1].inlier_ratio - 0.003);
  EXPECT_LT(ours.rotation_error_deg_mean, first->rows[7].rotation_error_deg_mean);  // best_fit
  const std::string csv = ToCsv(first->rows);
  EXPECT_THAT(csv, StartsWith("noise_px,method,experiments,failures,rotation_error_deg_mean,"
                              "rotation_error_deg_std,translation_error_mean,"
                              "translation_error_std,inlier_ratio_mean,time_ms_median\n"
                              "0,five_point_in_air,4,0,"));
  for (const char* method : {"best_fit", "best_fit_refined", "hu17", "gr6p", "ours"})
    EXPECT_THAT(csv, HasSubstr(std::string("\n1,") + method + ",4,"));
  const std::string svg = SolverFigureSvg(*first);
  EXPECT_THAT(svg, StartsWith("<svg "));
  EXPECT_THAT(svg, HasSubstr("17-point"));
  EXPECT_EQ(svg.find("nan"), std::string::npos);
}

TEST(SolverEvaluation, StopsWhenAsked) {
  const SolverRequest request = Request(SolverFigure::kAbsolutePose, SolverPort::kDome);
  EXPECT_FALSE(EvaluateSolvers(request, [](std::int64_t done) { return done < 3; }));
}

}  // namespace
}  // namespace rsfm

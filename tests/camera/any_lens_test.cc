// The lens chosen at run time is the lens of that model; the reverted series is an inverse.
#include "rsfm/camera/any_lens.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "rsfm/base/rng.h"
#include "tests/support/malloc_trap.h"

namespace rsfm {
namespace {

std::array<double, kMaxLensParams> MildParams(LensModel model) {
  std::array<double, kMaxLensParams> params{};
  const int focals = NumFocalLengths(model);
  for (int i = 0; i < NumLensParams(model); ++i) {
    params[i] = i < focals ? 1000.0 + i : i < focals + 2 ? 500.0 + i : 0.02 / (i - focals - 1);
  }
  if (model == LensModel::kFov) params[4] = 0.6;
  if (model == LensModel::kEucm) params[5] = 1.1;
  return params;
}

TEST(AnyLens, EveryModelIsThereAndInvertsItself) {
  for (const LensModel model : AllLensModels()) {
    const auto params = MildParams(model);
    const auto size = static_cast<std::size_t>(NumLensParams(model));
    const auto lens = AnyLens::Create(model, {params.data(), size});
    ASSERT_TRUE(lens) << ToString(model);
    EXPECT_EQ(lens->model(), model);
    EXPECT_FALSE(AnyLens::Create(model, {params.data(), size - 1}));
    MallocTrap trap;
    const AnyLens copy = *lens;
    const Vec3 direction = Vec3(0.3, -0.2, 1.0).normalized();
    Vec2 pixel, with_direction, with_params;
    Mat23 of_direction, also_of_direction;
    LensParamsJacobian of_params;
    Vec3 back;
    EXPECT_EQ(copy.Project(direction, &pixel), LensStatus::kOk);
    EXPECT_EQ(copy.Project(direction, &with_direction, &of_direction), LensStatus::kOk);
    EXPECT_EQ(copy.Project(direction, &with_params, &also_of_direction, &of_params),
              LensStatus::kOk);
    EXPECT_EQ(copy.Unproject(pixel, &back), LensStatus::kOk);
    LensBlock block;
    for (int i = 0; i < kLensBlock; ++i) {
      block.x[i] = pixel.x();
      block.y[i] = pixel.y();
    }
    copy.UnprojectBlock(&block);
    EXPECT_EQ(trap.count(), 0u);
    EXPECT_LT((pixel - with_direction).norm() + (pixel - with_params).norm(), 1e-12);
    EXPECT_LT((of_direction - also_of_direction).norm(), 1e-12);
    EXPECT_LT((back - direction).norm(), 1e-14) << ToString(model);
    EXPECT_TRUE(of_params.rightCols(kMaxLensParams - NumLensParams(model)).isZero());
    EXPECT_FALSE(of_params.leftCols(NumLensParams(model)).isZero());
    for (int i = 0; i < kLensBlock; ++i) {
      ASSERT_EQ(block.settled[i], 1.0) << ToString(model);
      const Vec3 of_block(block.direction_x[i], block.direction_y[i], block.direction_z[i]);
      ASSERT_LT((of_block - back).norm(), 1e-14);
    }
  }
  EXPECT_FALSE(AnyLens::Create(static_cast<LensModel>(99), {}));
}

// Blocks settle what the lens settles, and nothing else.
TEST(AnyLens, BlocksAgreeWithSinglePixels) {
  Rng rng(15);
  for (const LensModel model : AllLensModels()) {
    const auto params = MildParams(model);
    const auto lens =
        AnyLens::Create(model, {params.data(), static_cast<std::size_t>(NumLensParams(model))});
    int settled = 0;
    for (int round = 0; round < 20; ++round) {
      LensBlock block;
      std::array<Vec2, kLensBlock> pixels;
      for (int i = 0; i < kLensBlock; ++i) {
        pixels[i] = Vec2(rng.Uniform(-500, 1500), rng.Uniform(-500, 1500));
        if (i % 16 == 0) pixels[i] *= 100.0;
        if (i == 5) pixels[i].x() = std::nan("");
        block.x[i] = pixels[i].x();
        block.y[i] = pixels[i].y();
      }
      lens->UnprojectBlock(&block);
      for (int i = 0; i < kLensBlock; ++i) {
        if (block.settled[i] == 0.0) continue;
        ++settled;
        Vec3 direction;
        ASSERT_EQ(lens->Unproject(pixels[i], &direction), LensStatus::kOk)
            << ToString(model) << " " << pixels[i].transpose();
        const Vec3 of_block(block.direction_x[i], block.direction_y[i], block.direction_z[i]);
        ASSERT_LT((of_block - direction).norm(), 1e-13) << ToString(model);
      }
    }
    EXPECT_GT(settled, 20 * 48) << ToString(model);
  }
}

TEST(InverseSeries, RevertsToItsOrder) {
  const std::array<double, InverseSeries::kTerms> a{-0.3, 0.1, -0.02, 0.01, 0.003, -0.001};
  const InverseSeries series = RevertRadialSeries(a);
  EXPECT_DOUBLE_EQ(series.b[0], 0.3);
  EXPECT_DOUBLE_EQ(series.b[1], 3.0 * 0.09 - 0.1);
  EXPECT_NEAR(series.b[2], 12.0 * 0.027 - 8.0 * 0.03 + 0.02, 1e-15);
  double last = 1.0;
  for (const double r : {0.4, 0.2, 0.1}) {  // the error falls with the fifteenth power of r
    double y = r, power = r;
    for (const double coefficient : a) y += coefficient * (power *= r * r);
    const double error = std::abs(y * (1.0 + series.Factor(y * y)) - r);
    EXPECT_LT(error, last);
    last = error / 1000.0;
  }
}

}  // namespace
}  // namespace rsfm

#include "rsfm/estimation/pose_prior.h"

#include <gtest/gtest.h>

#include <limits>
#include <vector>

#include "rsfm/base/rng.h"
#include "tests/support/malloc_trap.h"

namespace rsfm {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

Rigid3 RandomPose(Rng* rng) {
  const auto vector = [rng](double size) {
    return Vec3(rng->Uniform(-size, size), rng->Uniform(-size, size), rng->Uniform(-size, size));
  };
  const Vec3 turn = vector(1.5);
  return {ExpSo3(turn), vector(4.0)};
}

Mat6 SomeCovariance(Rng* rng) {
  Mat6 root;
  for (int i = 0; i < 36; ++i) root(i) = rng->Uniform(-0.1, 0.1);
  return root * root.transpose() + 0.01 * Mat6::Identity();
}

class PosePriorTest : public testing::Test {
 protected:
  PosePriorTest() {
    const Rigid3 measured = RandomPose(&rng_);
    priors_ = {
        *MakePositionPrior(0, body_from_camera_, measured.translation, Vec3(0.1, 0.2, 0.05)),
        *MakeDepthPrior(0, body_from_camera_, 12.0, 0.03),
        *MakeAttitudePrior(0, body_from_camera_, measured.rotation, Vec3(0.01, 0.02, 0.05)),
        *MakePosePrior(0, body_from_camera_, measured, SomeCovariance(&rng_)),
        *MakeDisplacementPrior(0, 1, body_from_camera_, Vec3(1.0, 0.1, 0.0), Vec3(0.1, 0.1, 0.2)),
        *MakeRelativePosePrior(0, 1, body_from_camera_, measured, SomeCovariance(&rng_)),
        *MakeBaselinePrior(0, 1, body_from_camera_, 2.0, 0.01)};
  }
  Rng rng_{11};
  Rigid3 body_from_camera_ = RandomPose(&rng_);
  Rigid3 a_ = RandomPose(&rng_), b_ = RandomPose(&rng_);
  std::vector<PosePrior> priors_;
};

TEST_F(PosePriorTest, DerivativesMatchDifferences) {
  for (const PosePrior& prior : priors_) {
    const PriorEvaluation e = EvaluatePrior(prior, a_, b_);
    EXPECT_EQ(e.dimension, prior.Dimension());
    for (int i = 0; i < 6; ++i) {
      const double h = 1e-5;
      const Vec6 step = h * Vec6::Unit(i);
      const Vec6 d_a = (EvaluatePrior(prior, Perturb(a_, step), b_).residual -
                        EvaluatePrior(prior, Perturb(a_, -step), b_).residual) /
                       (2.0 * h);
      const Vec6 d_b = (EvaluatePrior(prior, a_, Perturb(b_, step)).residual -
                        EvaluatePrior(prior, a_, Perturb(b_, -step)).residual) /
                       (2.0 * h);
      EXPECT_LT((e.d_residual_d_a.col(i) - d_a).norm(), 1e-7 * (1.0 + e.d_residual_d_a.norm()))
          << static_cast<int>(prior.kind) << " " << i;
      EXPECT_LT((e.d_residual_d_b.col(i) - d_b).norm(), 1e-7 * (1.0 + e.d_residual_d_b.norm()))
          << static_cast<int>(prior.kind) << " " << i;
    }
  }
}

TEST_F(PosePriorTest, ResidualIsZeroAtTheMeasurement) {
  const Rigid3 world_from_a = a_.Inverse() * body_from_camera_.Inverse();
  const Rigid3 world_from_b = b_.Inverse() * body_from_camera_.Inverse();
  const Rigid3 a_from_b = world_from_a.Inverse() * world_from_b;
  const Vec3 sigma = Vec3::Constant(0.01);
  const Mat6 covariance = 1e-4 * Mat6::Identity();
  const PosePrior exact[] = {
      *MakePositionPrior(0, body_from_camera_, world_from_a.translation, sigma),
      *MakeDepthPrior(0, body_from_camera_, world_from_a.translation.z(), 0.01),
      *MakeAttitudePrior(0, body_from_camera_, world_from_a.rotation, sigma),
      *MakePosePrior(0, body_from_camera_, world_from_a, covariance),
      *MakeDisplacementPrior(0, 1, body_from_camera_, a_from_b.translation, sigma),
      *MakeRelativePosePrior(0, 1, body_from_camera_, a_from_b, covariance),
      *MakeBaselinePrior(0, 1, body_from_camera_,
                         (world_from_a.translation - world_from_b.translation).norm(), 0.01)};
  for (const PosePrior& prior : exact)
    EXPECT_LT(EvaluatePrior(prior, a_, b_).residual.norm(), 1e-11) << static_cast<int>(prior.kind);
}

// A correlated covariance weights as its inverse, not as its diagonal.
TEST_F(PosePriorTest, FullCovarianceIsMahalanobis) {
  const Mat6 covariance = SomeCovariance(&rng_);
  const Rigid3 measured = RandomPose(&rng_);
  const PosePrior full = *MakePosePrior(0, body_from_camera_, measured, covariance);
  const PosePrior plain = *MakePosePrior(0, body_from_camera_, measured, Mat6::Identity());
  const Vec6 difference = EvaluatePrior(plain, a_, b_).residual;
  EXPECT_NEAR(EvaluatePrior(full, a_, b_).residual.squaredNorm(),
              difference.dot(covariance.inverse() * difference), 1e-6);
}

TEST_F(PosePriorTest, RefusesBadInput) {
  const Vec3 good = Vec3::Constant(0.1);
  const auto where = [](const Expected<PosePrior>& prior) {
    return prior ? std::string() : std::string(prior.error().where);
  };
  EXPECT_EQ(where(MakePositionPrior(0, body_from_camera_, Vec3::Zero(), Vec3(0.1, 0.0, 0.1))),
            "sigma_position_m");
  EXPECT_EQ(where(MakePositionPrior(0, body_from_camera_, Vec3(kNan, 0.0, 0.0), good)), "measured");
  EXPECT_EQ(where(MakePositionPrior(-1, body_from_camera_, Vec3::Zero(), good)), "keyframe");
  EXPECT_EQ(where(MakeDepthPrior(0, body_from_camera_, 1.0, kNan)), "sigma_depth_m");
  EXPECT_EQ(where(MakeDepthPrior(0, body_from_camera_, kNan, 1.0)), "measured");
  EXPECT_EQ(where(MakeAttitudePrior(0, body_from_camera_, Quat::Identity(), -good)),
            "sigma_attitude_rad");
  EXPECT_EQ(where(MakeAttitudePrior(0, body_from_camera_, Quat(0.5, 0.0, 0.0, 0.0), good)),
            "measured");
  EXPECT_EQ(where(MakePosePrior(0, body_from_camera_, Rigid3(), Mat6::Zero())), "covariance");
  EXPECT_EQ(where(MakePosePrior(0, body_from_camera_, Rigid3(), Mat6::Constant(kNan))),
            "covariance");
  EXPECT_EQ(where(MakeDisplacementPrior(2, 2, body_from_camera_, Vec3::Zero(), good)), "keyframe");
  EXPECT_EQ(where(MakeBaselinePrior(0, 1, body_from_camera_, 0.0, 1.0)), "distance_m");
  EXPECT_EQ(where(MakeBaselinePrior(0, 1, body_from_camera_, 1.0, 0.0)), "sigma_baseline_m");
  Rigid3 bad = body_from_camera_;
  bad.translation.x() = kNan;
  EXPECT_EQ(where(MakeDepthPrior(0, bad, 1.0, 1.0)), "body_from_camera");
}

TEST_F(PosePriorTest, DoesNotAllocate) {
  MallocTrap trap;
  double sum = 0.0;
  for (const PosePrior& prior : priors_) sum += EvaluatePrior(prior, a_, b_).residual.sum();
  EXPECT_TRUE(std::isfinite(sum));
  EXPECT_EQ(trap.count(), 0u);
}

TEST(RobustLossTest, WeightIsTheDerivative) {
  for (const LossType type : {LossType::kNone, LossType::kHuber, LossType::kCauchy}) {
    const RobustLoss loss{type, 1.7};
    for (const double s : {0.0, 0.5, 2.0, 2.95, 10.0, 1e4}) {
      const double h = 1e-5 * (1.0 + s);
      EXPECT_NEAR(loss.Weight(s + h), (loss.Rho(s + 2.0 * h) - loss.Rho(s)) / (2.0 * h), 1e-5);
      EXPECT_LE(loss.Rho(s), s + 1e-12);
    }
  }
}

}  // namespace
}  // namespace rsfm

// Navigation factors, sensor states and marginalisation in window adjustment.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <limits>
#include <vector>

#include "rsfm/estimation/window_ba.h"
#include "tests/support/malloc_trap.h"
#include "tests/support/rigs.h"
#include "tests/support/survey.h"

namespace rsfm {
namespace {

const Rigid3 kBodyFromCamera(ExpSo3(Vec3(0.02, -0.03, 1.5)), Vec3(0.3, 0.05, 0.1));

Vec3 RandomVector(Rng* rng, double sigma) {
  return sigma * Vec3(rng->Gaussian(), rng->Gaussian(), rng->Gaussian());
}
Rigid3 RandomPose(Rng* rng) { return {ExpSo3(RandomVector(rng, 0.6)), RandomVector(rng, 2.0)}; }

NavFactor RandomFactor(NavFactorKind kind, Rng* rng) {
  NavFactor factor;
  factor.kind = kind;
  factor.b = kind == NavFactorKind::kDisplacement ? 1 : -1;
  factor.body_from_camera = kBodyFromCamera;
  factor.ned_from_body = ExpSo3(RandomVector(rng, 0.5));
  factor.measured_m = RandomVector(rng, 1.0);
  factor.rate_radps = RandomVector(rng, 0.3);
  factor.velocity_mps = RandomVector(rng, 0.5);
  for (int i = 0; i < 9; ++i) {
    factor.by_misalignment(i) = rng->Gaussian();
    factor.turned(i) = 0.1 * rng->Gaussian();
  }
  factor.sqrt_information = Vec3(2.0, 3.0, 4.0).asDiagonal();
  if (kind == NavFactorKind::kDepth) factor.sqrt_information = Vec3(2.0, 0.0, 0.0).asDiagonal();
  return factor;
}

class NavFactorLaw : public testing::TestWithParam<NavFactorKind> {};
INSTANTIATE_TEST_SUITE_P(Kinds, NavFactorLaw,
                         testing::Values(NavFactorKind::kAttitude, NavFactorKind::kDisplacement,
                                         NavFactorKind::kDepth, NavFactorKind::kPosition));

TEST_P(NavFactorLaw, JacobiansMatchDifferences) {
  Rng rng(17);
  for (int trial = 0; trial < 20; ++trial) {
    const NavFactor factor = RandomFactor(GetParam(), &rng);
    const Rigid3 a = RandomPose(&rng), b = RandomPose(&rng);
    NavStates states;
    for (int i = 0; i < kNumNavStates; ++i) states[i] = 0.05 * rng.Gaussian();
    const NavEvaluation e = EvaluateNavFactor(factor, a, b, states);
    constexpr double kStep = 1e-6;
    for (int i = 0; i < 6; ++i) {
      Vec6 step = Vec6::Zero();
      step[i] = kStep;
      const Vec3 by_a = (EvaluateNavFactor(factor, Perturb(a, step), b, states).residual -
                         EvaluateNavFactor(factor, Perturb(a, -step), b, states).residual) /
                        (2.0 * kStep);
      const Vec3 by_b = (EvaluateNavFactor(factor, a, Perturb(b, step), states).residual -
                         EvaluateNavFactor(factor, a, Perturb(b, -step), states).residual) /
                        (2.0 * kStep);
      EXPECT_LT((by_a - e.d_residual_d_a.col(i)).norm(), 1e-7) << i;
      EXPECT_LT((by_b - e.d_residual_d_b.col(i)).norm(), 1e-7) << i;
    }
    for (int i = 0; i < kNumNavStates; ++i) {
      NavStates more = states, less = states;
      more[i] += kStep;
      less[i] -= kStep;
      const Vec3 by_state = (EvaluateNavFactor(factor, a, b, more).residual -
                             EvaluateNavFactor(factor, a, b, less).residual) /
                            (2.0 * kStep);
      EXPECT_LT((by_state - e.d_residual_d_states.col(i)).norm(), 1e-7) << "state " << i;
    }
  }
}

TEST(NavFactor, RefusesWhatIsNotFinite) {
  Rng rng(3);
  NavFactor factor = RandomFactor(NavFactorKind::kDisplacement, &rng);
  EXPECT_TRUE(ValidateNavFactor(factor));
  factor.measured_m.y() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_STREQ(ValidateNavFactor(factor).error().where, "nav_factor.measured");
  factor = RandomFactor(NavFactorKind::kDisplacement, &rng);
  factor.b = factor.a;
  EXPECT_STREQ(ValidateNavFactor(factor).error().where, "nav_factor.keyframe");
  factor = RandomFactor(NavFactorKind::kAttitude, &rng);
  factor.ned_from_body.coeffs() *= 1.1;
  EXPECT_STREQ(ValidateNavFactor(factor).error().where, "nav_factor.ned_from_body");
}

TEST(PoseDifference, DerivativeMatchesDifferences) {
  Rng rng(5);
  for (int trial = 0; trial < 20; ++trial) {
    const Rigid3 a = RandomPose(&rng);
    Vec6 apart;
    apart << RandomVector(&rng, 0.03), RandomVector(&rng, 0.2);
    const Rigid3 b = Perturb(a, apart);
    Mat6 derivative;
    EXPECT_LT((PoseDifference(b, a, &derivative) - apart).norm(), 1e-12);
    for (int i = 0; i < 6; ++i) {
      Vec6 step = Vec6::Zero();
      step[i] = 1e-6;
      const Vec6 numeric = (PoseDifference(Perturb(b, step), a, nullptr) -
                            PoseDifference(Perturb(b, -step), a, nullptr)) /
                           2e-6;
      EXPECT_LT((numeric - derivative.col(i)).norm(), 1e-5);
    }
  }
}

// H and g of a prior as one matrix.
Eigen::MatrixXd Dense(const MarginalPrior& prior) {
  const int size = 6 * prior.num_blocks();
  Eigen::MatrixXd h(size, size);
  for (int i = 0; i < prior.num_blocks(); ++i) {
    for (int j = 0; j <= i; ++j) {
      h.block(6 * i, 6 * j, 6, 6) = prior.information.Block(i, j);
      h.block(6 * j, 6 * i, 6, 6) = prior.information.Block(i, j).transpose();
    }
  }
  return h;
}
Eigen::VectorXd Gradient(const MarginalPrior& prior) {
  Eigen::VectorXd g(6 * prior.num_blocks());
  for (int i = 0; i < prior.num_blocks(); ++i)
    g.segment(6 * i, 6) = prior.gradient[static_cast<std::size_t>(i)];
  return g;
}

MarginalPrior RandomPrior(int poses, Rng* rng) {
  MarginalPrior prior(poses);
  prior.Clear();
  for (int k = 0; k < poses; ++k) prior.first_estimates.TryPushBack(RandomPose(rng));
  prior.has_states = true;
  const int size = 6 * prior.num_blocks();
  Eigen::MatrixXd root(size, size);
  for (int i = 0; i < size * size; ++i) root(i) = rng->Gaussian();
  const Eigen::MatrixXd h = root * root.transpose() + Eigen::MatrixXd::Identity(size, size);
  prior.information.Reset(prior.num_blocks());
  prior.gradient.TryResizeForOverwrite(static_cast<std::size_t>(prior.num_blocks()));
  for (int i = 0; i < prior.num_blocks(); ++i) {
    for (int j = 0; j <= i; ++j) prior.information.Block(i, j) = h.block(6 * i, 6 * j, 6, 6);
    for (int k = 0; k < 6; ++k) prior.gradient[static_cast<std::size_t>(i)][k] = rng->Gaussian();
  }
  prior.cost = 100.0;
  return prior;
}

TEST(MarginalPrior, NoiseAddsToTheCovarianceAndMovesNothing) {
  Rng rng(8);
  MarginalPrior prior = RandomPrior(2, &rng);
  const Eigen::MatrixXd before = Dense(prior).inverse();
  const Eigen::VectorXd mean = before * Gradient(prior);
  const double lowest = prior.cost - 0.5 * Gradient(prior).dot(mean);
  NavStates variances = NavStates::Zero();
  variances[kHeadingBias] = 0.3;
  variances[kVelocityLever] = 0.1;
  const Vec3 direction(0.0, 0.6, 0.8);
  Eigen::VectorXd along = Eigen::VectorXd::Zero(before.rows());
  for (int k = 0; k < 2; ++k)
    along.segment<3>(6 * k + 3) =
        -(prior.first_estimates[static_cast<std::size_t>(k)].rotation * direction);
  prior.AddNoise(variances);
  prior.AddTranslationNoise(direction, 0.7);
  Eigen::MatrixXd expected = before + 0.7 * along * along.transpose();
  expected(12 + kHeadingBias, 12 + kHeadingBias) += 0.3;
  expected(12 + kVelocityLever, 12 + kVelocityLever) += 0.1;
  const Eigen::MatrixXd after = Dense(prior).inverse();
  EXPECT_LT((after - expected).norm(), 1e-9 * expected.norm());
  EXPECT_LT((after * Gradient(prior) - mean).norm(), 1e-9 * mean.norm());
  EXPECT_NEAR(prior.cost - 0.5 * Gradient(prior).dot(mean), lowest, 1e-9);
}

TEST(MarginalPrior, RebasingAPoseKeepsTheMinimum) {
  Rng rng(9);
  MarginalPrior prior = RandomPrior(2, &rng);
  const Eigen::VectorXd mean = -Dense(prior).inverse() * Gradient(prior);
  const double lowest = prior.cost + 0.5 * Gradient(prior).dot(mean);
  Vec6 moved;
  moved << RandomVector(&rng, 1e-4), RandomVector(&rng, 1e-4);
  prior.Rebase(1, Perturb(prior.first_estimates[1], moved));
  Eigen::VectorXd expected = mean;
  expected.segment<6>(6) -= moved;
  const Eigen::VectorXd after = -Dense(prior).inverse() * Gradient(prior);
  EXPECT_LT((after - expected).norm(), 1e-6);
  EXPECT_NEAR(prior.cost + 0.5 * Gradient(prior).dot(after), lowest, 1e-6);
}

// A survey with navigation of its own: what a window is made of.
struct Mission {
  Survey survey;
  std::vector<NavFactor> factors;  // a, b count images of the survey
  std::vector<double> altitudes;   // of the body above point `below`
  std::vector<int> below;
  NavStates truth = NavStates::Zero();
};

struct MissionOptions {
  double heading_bias_rad = 0.01;
  double scale = 0.004;
  double noise = 1.0;  // times the sigmas below
  double pixel_noise = 0.3;
  std::uint64_t seed = 4;
};
constexpr double kSigmaAttitude = 0.002, kSigmaDisplacement = 0.004, kSigmaDepth = 0.02;

NavFactor Make(NavFactorKind kind, int a, int b, double sigma) {
  NavFactor factor;
  factor.kind = kind;
  factor.a = a;
  factor.b = b;
  factor.body_from_camera = kBodyFromCamera;
  factor.sqrt_information = Vec3::Constant(1.0 / sigma).asDiagonal();
  if (kind == NavFactorKind::kDepth)
    factor.sqrt_information = Vec3(1.0 / sigma, 0.0, 0.0).asDiagonal();
  return factor;
}

Mission MakeMission(const AnyCamera& camera, const MissionOptions& options) {
  Mission mission;
  SurveyOptions survey;
  survey.lines = 1;
  survey.images_per_line = 8;
  survey.noise_px = options.pixel_noise;
  survey.num_points = 200;
  survey.seed = options.seed;
  mission.survey = MakeSurvey(camera, survey);
  mission.truth[kHeadingBias] = options.heading_bias_rad;
  mission.truth[kVelocityScale] = options.scale;
  Rng rng(options.seed + 100);
  const auto& poses = mission.survey.camera_from_world;
  for (int k = 0; k < static_cast<int>(poses.size()); ++k) {
    const CarriedBody body(kBodyFromCamera, poses[static_cast<std::size_t>(k)]);
    NavFactor attitude = Make(NavFactorKind::kAttitude, k, -1, kSigmaAttitude);
    attitude.ned_from_body =
        (ExpSo3(Vec3(0, 0, options.heading_bias_rad)) *
         ExpSo3(RandomVector(&rng, options.noise * kSigmaAttitude)) * Quat(body.world_from_body))
            .normalized();
    NavFactor depth = Make(NavFactorKind::kDepth, k, -1, kSigmaDepth);
    depth.measured_m.z() = body.position.z() + options.noise * kSigmaDepth * rng.Gaussian();
    mission.factors.push_back(attitude);
    mission.factors.push_back(depth);
    int nearest = 0;
    for (int p = 0; p < static_cast<int>(mission.survey.points.size()); ++p) {
      const auto away = [&](int i) {
        return (mission.survey.points[static_cast<std::size_t>(i)] - body.position)
            .head<2>()
            .norm();
      };
      if (away(p) < away(nearest)) nearest = p;
    }
    mission.below.push_back(nearest);
    mission.altitudes.push_back(mission.survey.points[static_cast<std::size_t>(nearest)].z() -
                                body.position.z() + options.noise * 0.01 * rng.Gaussian());
    if (k == 0) continue;
    const CarriedBody before(kBodyFromCamera, poses[static_cast<std::size_t>(k - 1)]);
    NavFactor moved = Make(NavFactorKind::kDisplacement, k - 1, k, kSigmaDisplacement);
    moved.measured_m = ExpSo3(Vec3(0, 0, options.heading_bias_rad)) *
                       (body.position - before.position) * (1.0 + options.scale);
    moved.measured_m += RandomVector(&rng, options.noise * kSigmaDisplacement);
    moved.by_misalignment = -Hat(moved.measured_m);
    moved.turned = body.world_from_body - before.world_from_body;
    mission.factors.push_back(moved);
  }
  return mission;
}

NavStates StateSigmas() {
  NavStates sigmas = NavStates::Zero();
  sigmas[kHeadingBias] = 0.03;
  sigmas[kVelocityScale] = 0.01;
  return sigmas;
}

class NavWindow : public testing::Test {
 protected:
  WindowBa MakeBa() {
    return *WindowBa::Create(
        {.keyframes = 12, .landmarks = 300, .observations = 3000, .priors = 8, .nav_factors = 64});
  }
  // Everything of a mission but the kinds in `without`, from a disturbed start.
  void Fill(const Mission& mission, std::span<const NavFactorKind> without, bool altitudes,
            WindowBa* ba, double heading_sigma_rad = 0.03) {
    Survey start = mission.survey;
    Disturb(&start, 0, 0.001, 0.01, 0.01, 5);
    ba->Clear();
    for (const Rigid3& pose : start.camera_from_world) ASSERT_TRUE(ba->AddKeyframe(pose));
    for (const Vec3& point : start.points) ASSERT_TRUE(ba->AddLandmark(point));
    MarginalPrior states(12);
    NavStates sigmas = StateSigmas();
    sigmas[kHeadingBias] = heading_sigma_rad;
    states.StartWithStates(NavStates::Zero(), sigmas);
    ASSERT_TRUE(ba->SetMarginalPrior(states, {}, NavStates::Zero()));
    for (const SurveyObservation& o : mission.survey.observations)
      ASSERT_TRUE(ba->AddObservation(o.image, o.point, o.pixel));
    for (const NavFactor& factor : mission.factors) {
      if (std::find(without.begin(), without.end(), factor.kind) != without.end()) continue;
      ASSERT_TRUE(ba->AddNavFactor(factor));
    }
    for (std::size_t k = 0; altitudes && k < mission.below.size(); ++k)
      ASSERT_TRUE(ba->AddAltitude(static_cast<int>(k), mission.below[k], kBodyFromCamera,
                                  mission.altitudes[k], 0.01));
    // Where the world is: the first body.
    const CarriedBody first(kBodyFromCamera, mission.survey.camera_from_world[0]);
    ASSERT_TRUE(ba->AddPrior(
        *MakePositionPrior(0, kBodyFromCamera, first.position, Vec3(1e-3, 1e-3, 10.0))));
  }
  static double Rmse(const Mission& mission, const WindowBa& ba) {
    double sum = 0.0;
    for (int k = 0; k < ba.num_keyframes(); ++k)
      sum += (ba.camera_from_world(k).OriginOfTarget() -
              mission.survey.camera_from_world[static_cast<std::size_t>(k)].OriginOfTarget())
                 .squaredNorm();
    return std::sqrt(sum / ba.num_keyframes());
  }
  static WindowBaOptions Tight() {
    WindowBaOptions options;
    options.max_iterations = 50;
    options.function_tolerance = 1e-13;
    return options;
  }
  Rng rng_{3};
  std::vector<AnyCamera> cameras_{RandomRig(RigKind::kFlat, &rng_)};
};

TEST_F(NavWindow, FindsPosesAndSensorErrorsWithoutNoise) {
  MissionOptions options;
  options.noise = 0.0;
  options.pixel_noise = 0.0;
  const Mission mission = MakeMission(cameras_[0], options);
  WindowBa ba = MakeBa();
  Fill(mission, {}, true, &ba);
  ASSERT_TRUE(ba.Solve(cameras_, Tight()));
  // The bias and the scale have priors at 0 which the data outweigh where they can.
  EXPECT_LT(Rmse(mission, ba), 0.03);
  EXPECT_NEAR(ba.nav_states()[kVelocityScale], options.scale, 0.002);
  const auto covariance = ba.NavStateCovariance();
  ASSERT_TRUE(covariance);
  EXPECT_LT(std::sqrt((*covariance)(kVelocityScale, kVelocityScale)), 0.004);
}

// What each factor is worth: without it the answer, or what is known of it, gets worse.
TEST_F(NavWindow, EveryFactorCounts) {
  const Mission mission = MakeMission(cameras_[0], {});
  WindowBa ba = MakeBa();
  const auto sigma = [&](std::vector<NavFactorKind> without, bool altitudes) {
    Fill(mission, without, altitudes, &ba, 1e-3);
    EXPECT_TRUE(ba.Solve(cameras_, Tight()));
    const auto covariance = ba.PoseCovariance(ba.num_keyframes() - 1);
    return covariance ? std::sqrt(covariance->bottomRightCorner<3, 3>().trace()) : 1e9;
  };
  const double all = sigma({}, true);
  const double no_altitude = sigma({}, false);
  const double no_log = sigma({NavFactorKind::kDisplacement}, false);
  EXPECT_LT(all, 0.03);
  EXPECT_GT(sigma({NavFactorKind::kAttitude}, true), all) << "only the log has a heading";
  EXPECT_GT(sigma({NavFactorKind::kDepth}, true), 5.0) << "the gauge's ten metres";
  EXPECT_GT(no_altitude, 1.1 * all) << "the altimeter makes the log's scale better";
  EXPECT_GT(no_log, 1.5 * no_altitude) << "only changes of depth give the scale";
}

// The heart of it: keyframe after keyframe leaves, and what stays is where a batch over everything
// has it, with the same covariance.
TEST_F(NavWindow, WhatLeavesIsNotLost) {
  const Mission mission = MakeMission(cameras_[0], {});
  WindowBa batch = MakeBa();
  Fill(mission, {}, true, &batch);
  WindowBaOptions squares = Tight();
  squares.loss = {LossType::kNone, 1.0};
  ASSERT_TRUE(batch.Solve(cameras_, squares));
  const int count = batch.num_keyframes();
  const Mat6 all = *batch.PoseCovariance(count - 1);

  // Linearised at the optimum, a prior in place of the first four keyframes is exact.
  constexpr int kGone = 4;
  WindowBa leaving = MakeBa(), staying = MakeBa();
  leaving.Clear();
  staying.Clear();
  for (int k = 0; k < count; ++k) ASSERT_TRUE(leaving.AddKeyframe(batch.camera_from_world(k)));
  Rng rng(12);
  std::vector<int> kept;
  for (int k = kGone; k < count; ++k) {
    Vec6 off;
    off << RandomVector(&rng, 3e-4), RandomVector(&rng, 2e-3);
    ASSERT_TRUE(staying.AddKeyframe(Perturb(batch.camera_from_world(k), off)));
    kept.push_back(k - kGone);
  }
  MarginalPrior prior(12), states(12);
  states.StartWithStates(NavStates::Zero(), StateSigmas());
  ASSERT_TRUE(leaving.SetMarginalPrior(states, {}, batch.nav_states()));
  std::vector<char> is_gone(mission.survey.points.size(), 0);
  for (const SurveyObservation& o : mission.survey.observations)
    is_gone[static_cast<std::size_t>(o.point)] |= o.image < kGone;
  std::vector<int> place(mission.survey.points.size());
  for (std::size_t p = 0; p < place.size(); ++p) {
    WindowBa& ba = is_gone[p] ? leaving : staying;
    place[p] = *ba.AddLandmark(batch.point_in_world(static_cast<int>(p)));
  }
  for (const SurveyObservation& o : mission.survey.observations) {
    const auto p = static_cast<std::size_t>(o.point);
    if (is_gone[p]) {
      ASSERT_TRUE(leaving.AddObservation(o.image, place[p], o.pixel));
    } else {
      ASSERT_TRUE(staying.AddObservation(o.image - kGone, place[p], o.pixel));
    }
  }
  std::vector<NavFactor> later;
  for (const NavFactor& factor : mission.factors) {
    if (factor.a < kGone) {
      ASSERT_TRUE(leaving.AddNavFactor(factor));
    } else {
      later.push_back(factor);
    }
  }
  for (int k = 0; k < count; ++k) {
    const auto p = static_cast<std::size_t>(mission.below[static_cast<std::size_t>(k)]);
    const double altitude = mission.altitudes[static_cast<std::size_t>(k)];
    if (is_gone[p]) {
      ASSERT_TRUE(leaving.AddAltitude(k, place[p], kBodyFromCamera, altitude, 0.01));
    } else {
      ASSERT_TRUE(staying.AddAltitude(k - kGone, place[p], kBodyFromCamera, altitude, 0.01));
    }
  }
  const CarriedBody first(kBodyFromCamera, mission.survey.camera_from_world[0]);
  ASSERT_TRUE(leaving.AddPrior(
      *MakePositionPrior(0, kBodyFromCamera, first.position, Vec3(1e-3, 1e-3, 10.0))));
  MallocTrap trap;
  ASSERT_TRUE(leaving.Marginalise(cameras_, squares.loss, kGone, &prior));
  ASSERT_TRUE(staying.SetMarginalPrior(prior, kept, NavStates::Zero()));
  for (NavFactor factor : later) {
    factor.a -= kGone;
    if (factor.b >= 0) factor.b -= kGone;
    ASSERT_TRUE(staying.AddNavFactor(factor));
  }
  const auto report = staying.Solve(cameras_, squares);
  ASSERT_TRUE(report);
  EXPECT_EQ(trap.count(), 0u);
  for (int k = kGone; k < count; ++k) {
    const Vec6 off =
        PoseDifference(staying.camera_from_world(k - kGone), batch.camera_from_world(k), nullptr);
    EXPECT_LT(off.norm(), 1e-5) << k;
  }
  EXPECT_LT((staying.nav_states() - batch.nav_states()).norm(), 1e-5);
  const auto covariance = staying.PoseCovariance(count - 1 - kGone);
  ASSERT_TRUE(covariance);
  EXPECT_LT((*covariance - all).norm(), 1e-3 * all.norm());
}

TEST_F(NavWindow, RefusesWhatDoesNotFitUnharmed) {
  const Mission mission = MakeMission(cameras_[0], {});
  WindowBa ba = MakeBa();
  Fill(mission, {}, false, &ba);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_STREQ(ba.AddAltitude(0, 0, kBodyFromCamera, nan, 0.1).error().where, "altitude_m");
  EXPECT_STREQ(ba.AddAltitude(0, 0, kBodyFromCamera, 3.0, -1.0).error().where, "sigma_m");
  EXPECT_STREQ(ba.AddAltitude(99, 0, kBodyFromCamera, 3.0, 0.1).error().where, "keyframe");
  NavFactor factor = mission.factors[0];
  factor.a = 99;
  EXPECT_STREQ(ba.AddNavFactor(factor).error().where, "nav_factor.keyframe");
  MarginalPrior result(12);
  EXPECT_STREQ(ba.Marginalise(cameras_, {}, 99, &result).error().where, "num_gone");
  EXPECT_TRUE(ba.Solve(cameras_, Tight()));
  WindowBa without_states = MakeBa();
  without_states.Clear();
  ASSERT_TRUE(without_states.AddKeyframe(Rigid3()));
  EXPECT_STREQ(without_states.AddNavFactor(mission.factors[0]).error().where, "nav_factor.states");
  EXPECT_STREQ(without_states.NavStateCovariance().error().where, "states");
}

}  // namespace
}  // namespace rsfm

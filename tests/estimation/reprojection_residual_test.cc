#include "rsfm/estimation/reprojection_residual.h"

#include <gtest/gtest.h>

#include <limits>

#include "tests/support/malloc_trap.h"
#include "tests/support/rigs.h"

namespace rsfm {
namespace {

struct Case {
  const char* name;
  LensModel lens;
  StaticVector<double, kMaxLensParams> params;
  RigKind rig;
};

AnyCamera MakeCamera(const Case& c, Rng* rng) {
  CameraConfig config = RandomRig(c.rig, rng).config();
  config.lens = c.lens;
  config.lens_params = c.params;
  config.port.index_air = 1.0003;  // off its lower limit, so that it can be varied both ways
  return *AnyCamera::Create(config);
}

class ReprojectionResidualTest : public testing::TestWithParam<Case> {
 protected:
  Rng rng_{7};
  AnyCamera camera_ = MakeCamera(GetParam(), &rng_);
  Rigid3 camera_from_world_{ExpSo3(Vec3(0.4, -1.2, 2.0)), Vec3(0.3, -0.7, 1.5)};

  Vec3 RandomPointInWorld() {
    return camera_from_world_.Inverse() *
           Vec3(rng_.Uniform(-1.0, 1.0), rng_.Uniform(-0.6, 0.6), rng_.Uniform(2.0, 5.0));
  }
};

// Fourth-order central differences of the error.
template <class F>
Vec2 Difference(F&& error_at, double h) {
  return (8.0 * (error_at(h) - error_at(-h)) - (error_at(2.0 * h) - error_at(-2.0 * h))) /
         (12.0 * h);
}

Vec2 ErrorOf(const AnyCamera& camera, const Rigid3& pose, const Vec3& point) {
  Vec2 error(1e9, 1e9);
  EXPECT_EQ(ReprojectionError(camera, pose, point, Vec2(900.0, 500.0), &error), Projection::kOk);
  return error;
}

TEST_P(ReprojectionResidualTest, DerivativesMatchDifferences) {
  for (int trial = 0; trial < 20; ++trial) {
    const Vec3 point = RandomPointInWorld();
    Vec2 error, again;
    Mat26 d_pose;
    Mat23 d_point;
    ReprojectionJacobian all;
    ASSERT_EQ(ReprojectionError(camera_, camera_from_world_, point, Vec2(900.0, 500.0), &error,
                                &d_pose, &d_point),
              Projection::kOk);
    ASSERT_EQ(
        ReprojectionError(camera_, camera_from_world_, point, Vec2(900.0, 500.0), &again, &all),
        Projection::kOk);
    EXPECT_LT((error - ErrorOf(camera_, camera_from_world_, point)).norm(), 1e-9);
    EXPECT_LT((error - again).norm(), 1e-9);
    EXPECT_LT((d_pose - all.d_error_d_pose).norm(), 1e-9 * d_pose.norm());
    EXPECT_LT((d_point - all.d_error_d_point).norm(), 1e-9 * d_point.norm());
    for (int i = 0; i < 6; ++i) {
      const Vec2 numeric = Difference(
          [&](double h) {
            return ErrorOf(camera_, Perturb(camera_from_world_, h * Vec6::Unit(i)), point);
          },
          1e-4);
      EXPECT_LT((d_pose.col(i) - numeric).norm(), 1e-6 * d_pose.norm()) << i;
    }
    for (int i = 0; i < 3; ++i) {
      const Vec2 numeric = Difference(
          [&](double h) { return ErrorOf(camera_, camera_from_world_, point + h * Vec3::Unit(i)); },
          1e-4);
      EXPECT_LT((d_point.col(i) - numeric).norm(), 1e-6 * d_point.norm()) << i;
    }
  }
}

TEST_P(ReprojectionResidualTest, LensAndPortDerivativesMatchDifferences) {
  const Vec3 point = RandomPointInWorld();
  Vec2 error;
  ReprojectionJacobian j;
  ASSERT_EQ(ReprojectionError(camera_, camera_from_world_, point, Vec2(900.0, 500.0), &error, &j),
            Projection::kOk);
  for (std::size_t i = 0; i < camera_.config().lens_params.size(); ++i) {
    const double h = 1e-4 * std::max(1.0, std::abs(camera_.config().lens_params[i]));
    const Vec2 numeric = Difference(
        [&](double step) {
          CameraConfig config = camera_.config();
          config.lens_params[i] += step;
          return ErrorOf(*AnyCamera::Create(config), camera_from_world_, point);
        },
        h);
    EXPECT_LT((j.d_error_d_lens.col(static_cast<int>(i)) - numeric).norm(),
              1e-6 * (1.0 + numeric.norm()))
        << i;
  }
  if (camera_.config().port.type == PortType::kNone) {
    EXPECT_EQ(j.d_error_d_port.norm(), 0.0);
    return;
  }
  const bool flat = camera_.config().port.type == PortType::kFlat;
  for (int i = flat ? 3 : 0; i < kNumPortParams; ++i) {
    const Vec2 numeric = Difference(
        [&](double step) {
          CameraConfig config = camera_.config();
          PortParams params = config.port.Params();
          params[i] += step;
          config.port.SetParams(params);
          return ErrorOf(*AnyCamera::Create(config), camera_from_world_, point);
        },
        1e-5);
    EXPECT_LT((j.d_error_d_port.col(i) - numeric).norm(), 1e-5 * (1.0 + numeric.norm())) << i;
  }
  if (!flat) return;
  // The normal: along two directions that keep it a unit vector.
  const Vec3 normal = camera_.config().port.normal;
  for (const Vec3& axis : {Vec3(Vec3::UnitX()), Vec3(Vec3::UnitY())}) {
    const Vec3 tangent = normal.cross(axis).normalized();
    const Vec2 numeric = Difference(
        [&](double step) {
          CameraConfig config = camera_.config();
          config.port.normal = (normal + step * tangent).normalized();
          return ErrorOf(*AnyCamera::Create(config), camera_from_world_, point);
        },
        1e-4);
    EXPECT_LT((j.d_error_d_port.leftCols<3>() * tangent - numeric).norm(),
              1e-5 * (1.0 + numeric.norm()));
  }
}

TEST_P(ReprojectionResidualTest, ChainsToTheBody) {
  const Rigid3 camera_from_body(ExpSo3(Vec3(-0.3, 0.8, 0.2)), Vec3(0.2, 0.1, -0.4));
  const Rigid3 body_from_world = camera_from_body.Inverse() * camera_from_world_;
  const Vec3 point = RandomPointInWorld();
  Vec2 error;
  Mat26 d_pose;
  Mat23 d_point;
  ASSERT_EQ(ReprojectionError(camera_, camera_from_world_, point, Vec2(900.0, 500.0), &error,
                              &d_pose, &d_point),
            Projection::kOk);
  const Mat26 d_body = ChainToBody(d_pose, camera_from_body);
  for (int i = 0; i < 6; ++i) {
    const Vec2 numeric = Difference(
        [&](double h) {
          return ErrorOf(camera_, camera_from_body * Perturb(body_from_world, h * Vec6::Unit(i)),
                         point);
        },
        1e-4);
    EXPECT_LT((d_body.col(i) - numeric).norm(), 1e-6 * d_body.norm()) << i;
  }
}

TEST_P(ReprojectionResidualTest, ImpossibleLeavesOutputsAlone) {
  // Behind the camera, or on the camera's side of a port.
  const bool has_port = camera_.config().port.type != PortType::kNone;
  const Vec3 behind = camera_from_world_.Inverse() * Vec3(0.0, 0.0, has_port ? 1e-4 : -2.0);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const Vec3& point : {behind, Vec3(nan, 0.0, 1.0)}) {
    Vec2 error(1.0, 2.0);
    Mat26 d_pose = Mat26::Constant(3.0);
    Mat23 d_point = Mat23::Constant(4.0);
    EXPECT_NE(ReprojectionError(camera_, camera_from_world_, point, Vec2(0.0, 0.0), &error, &d_pose,
                                &d_point),
              Projection::kOk);
    EXPECT_EQ(error, Vec2(1.0, 2.0));
    EXPECT_EQ(d_pose, Mat26(Mat26::Constant(3.0)));
    EXPECT_EQ(d_point, Mat23(Mat23::Constant(4.0)));
  }
}

TEST_P(ReprojectionResidualTest, DoesNotAllocate) {
  const Vec3 point = RandomPointInWorld();
  Vec2 error;
  ReprojectionJacobian j;
  MallocTrap trap;
  ASSERT_EQ(ReprojectionError(camera_, camera_from_world_, point, Vec2(900.0, 500.0), &error, &j),
            Projection::kOk);
  EXPECT_EQ(trap.count(), 0u);
}

INSTANTIATE_TEST_SUITE_P(
    Cameras, ReprojectionResidualTest,
    testing::Values(
        Case{"pinhole_none", LensModel::kPinhole, {1300, 1290, 960, 540}, RigKind::kNone},
        Case{"pinhole_flat", LensModel::kPinhole, {1300, 1290, 960, 540}, RigKind::kFlat},
        Case{"radial_dome", LensModel::kSimpleRadial, {1300, 960, 540, -0.1}, RigKind::kDome},
        Case{"opencv_flat",
             LensModel::kOpenCV,
             {1300, 1290, 960, 540, -0.1, 0.02, 1e-3, -1e-3},
             RigKind::kFlat},
        Case{"fisheye_dome",
             LensModel::kOpenCVFisheye,
             {900, 910, 960, 540, -0.01, 0.02, 1e-3, 0},
             RigKind::kDome},
        Case{"pinhole_centred_dome",
             LensModel::kPinhole,
             {1300, 1290, 960, 540},
             RigKind::kCentredDome}),
    [](const testing::TestParamInfo<Case>& test) { return std::string(test.param.name); });

}  // namespace
}  // namespace rsfm

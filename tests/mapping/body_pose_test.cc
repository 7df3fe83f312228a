#include "rsfm/mapping/body_pose.h"

#include <gtest/gtest.h>

#include "rsfm/base/rng.h"
#include "tests/mapping/feature_world.h"

namespace rsfm {
namespace {

TEST(BodyPose, CovarianceIsThatOfPositionAndRotationAboutTheWorldsAxes) {
  Rng rng(8);
  const Rigid3 camera_from_world(ExpSo3(Vec3(0.4, -0.7, 1.1)), Vec3(3.0, -2.0, 5.0));
  Mat6 root;
  for (int i = 0; i < 36; ++i) root(i) = 0.01 * rng.Gaussian();
  const Mat6 covariance = root * root.transpose();
  const BodyPose pose = ToBodyPose(camera_from_world, covariance, DownwardCamera());
  // Through the definition, by differences along the columns of the root.
  Mat6 moved;
  for (int k = 0; k < 6; ++k) {
    const double h = 1e-5;
    const Rigid3 other =
        ToBodyPose(Perturb(camera_from_world, h * root.col(k)), covariance, DownwardCamera())
            .world_from_body;
    moved.col(k).head<3>() = (other.translation - pose.world_from_body.translation) / h;
    moved.col(k).tail<3>() = LogSo3(other.rotation * pose.world_from_body.rotation.conjugate()) / h;
  }
  EXPECT_LT((moved * moved.transpose() - pose.covariance).norm(), 1e-4 * pose.covariance.norm());
}

}  // namespace
}  // namespace rsfm

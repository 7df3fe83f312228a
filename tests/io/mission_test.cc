// Mission folders: what is logged comes back; a log that was cut loses only the cut event.
#include "rsfm/io/mission.h"

#include <gtest/gtest.h>

#include <cmath>

#include "rsfm/io/atomic_output.h"
#include "rsfm/io/nav_messages.h"
#include "rsfm/io/output_messages.h"
#include "rsfm/io/trajectory.h"
#include "tests/support/temporary_folder.h"

namespace rsfm {
namespace {

namespace fs = std::filesystem;

Rig SampleRig() {
  Rig rig;
  rig.camera.width = 640;
  rig.camera.height = 480;
  for (const double v : {500.0, 500.0, 320.0, 240.0}) {
    EXPECT_TRUE(rig.camera.lens_params.TryPushBack(v));
  }
  rig.body_from_camera = Rigid3(Quat(0.5, 0.5, 0.5, 0.5), Vec3(0.1, 0, 0.2));
  return rig;
}

keyframe_t Keyframe(int id, const Rigid3& camera_from_world) {
  keyframe_t m = {};
  m.utime = 1000 * id;
  m.id = id;
  m.image = "i" + std::to_string(id) + ".jpg";
  const Quat& q = camera_from_world.rotation;
  const double wxyz[4] = {q.w(), q.x(), q.y(), q.z()};
  for (int i = 0; i < 4; ++i) m.camera_from_world_q[i] = wxyz[i];
  for (int i = 0; i < 3; ++i) m.camera_from_world_t[i] = camera_from_world.translation[i];
  m.num_features = 3;
  m.x_px = {10.5f, 20.5f, 30.5f};
  m.y_px = {11.5f, 21.5f, 31.5f};
  m.size_px = {1, 1, 1};
  m.landmark_id = {7, -1, 8};
  m.descriptor_type = keyframe_t::DESCRIPTOR_ORB;
  m.descriptor_bytes = 32;
  m.num_descriptor_bytes = 96;
  m.descriptors.assign(96, 1);
  return m;
}

landmarks_t Landmarks(double x) {
  landmarks_t m = {};
  m.num = 2;
  m.id = {7, 8};
  m.x = {x, x + 1};
  m.y = m.z = {2, 3};
  m.r = m.g = m.b = {9, 10};
  return m;
}

class MissionTest : public ::testing::Test {
 protected:
  void SetUp() override {
    auto writer = MissionWriter::Create(folder_.path(), SampleRig());
    ASSERT_TRUE(writer);
    ASSERT_TRUE(writer->WriteImageTimes({{"i0.jpg", 0}, {"i1.jpg", 1000}}));
    NavSample nav;
    nav.Set(NavField::kDepth);
    for (const Utime utime : {500, 400}) {  // out of order on the bus
      nav.utime = utime;
      ASSERT_TRUE(writer->Log("RSFM_NAV", utime, ToMessage(nav)));
    }
    for (int i = 0; i < 2; ++i) {
      PoseOutput pose;
      pose.utime = 1000 * i;
      pose.world_from_body.translation = {1.0 * i, 0, 0};
      pose.state = pose_t::STATE_TRACKING;
      ASSERT_TRUE(writer->Log("RSFM_POSE", 1000 * i, MakePose(pose, World())));
      Rigid3 camera_from_world;
      camera_from_world.translation = {0.5 * i, 0, 0};
      ASSERT_TRUE(writer->Log("RSFM_KEYFRAME", 1000 * i, Keyframe(i, camera_from_world)));
      ASSERT_TRUE(writer->Log("RSFM_LANDMARKS", 1000 * i, Landmarks(5.0 + i)));
    }
    ASSERT_TRUE(writer->Close());
  }

  TemporaryFolder folder_;
};

TEST_F(MissionTest, WhatIsLoggedComesBack) {
  EXPECT_TRUE(IsMissionFolder(folder_.path()));
  const auto mission = ReadMission(folder_.path());
  ASSERT_TRUE(mission) << ToString(mission.error());
  EXPECT_EQ(mission->images.size(), 2u);
  ASSERT_EQ(mission->nav.size(), 2u);
  EXPECT_EQ(mission->nav[0].utime, 400);
  EXPECT_EQ(mission->poses.size(), 2u);
  ASSERT_EQ(mission->keyframes.size(), 2u);
  EXPECT_EQ(mission->keyframes[1].descriptors.size(), 96u);
  ASSERT_EQ(mission->landmarks.size(), 2u);
  EXPECT_EQ(mission->landmarks.at(7).xyz, Vec3(6, 2, 2));  // the last word
  EXPECT_EQ(mission->num_malformed, 0);
  EXPECT_EQ(mission->log.num_events, 8);

  const auto trajectory = TrajectoryOf(*mission);
  ASSERT_EQ(trajectory.size(), 2u);
  EXPECT_EQ(trajectory[1].image, "i1.jpg");
  EXPECT_EQ(trajectory[1].world_from_camera.translation, Vec3(1.1, 0, 0.2));

  const Model model = ModelFromMission(*mission);
  EXPECT_TRUE(Validate(model));
  ASSERT_EQ(model.images.size(), 2u);
  EXPECT_EQ(model.images[1].name, "i1.jpg");
  ASSERT_EQ(model.points.size(), 2u);
  EXPECT_EQ(model.points[0].track.size(), 2u);

  const auto lean = ReadMission(folder_.path(), {.keep_descriptors = false});
  ASSERT_TRUE(lean);
  EXPECT_TRUE(lean->keyframes[1].descriptors.empty());
}

TEST_F(MissionTest, ACutLogLosesOnlyTheCutEvent) {
  const std::string bytes = *ReadWholeFile(folder_.path() / kEventsFile);
  ASSERT_TRUE(WriteFileAtomically(folder_.path() / kEventsFile, bytes.substr(0, bytes.size() - 9)));
  const auto mission = ReadMission(folder_.path());
  ASSERT_TRUE(mission) << ToString(mission.error());
  EXPECT_EQ(mission->log.num_events, 7);
  EXPECT_GT(mission->log.cut_bytes, 0);
  EXPECT_EQ(mission->keyframes.size(), 2u);
  EXPECT_EQ(mission->landmarks.at(7).xyz, Vec3(5, 2, 2));
}

TEST_F(MissionTest, ACutTableOfImagesLosesOnlyTheCutRow) {
  const std::filesystem::path table = folder_.path() / kImagesFile;
  const std::string text = *ReadWholeFile(table);
  for (const char* cut : {"i2", "i2.jpg,", "i2.jpg,3", "i2.jpg,9999999999"}) {
    ASSERT_TRUE(WriteFileAtomically(table, text + cut));
    const auto mission = ReadMission(folder_.path());
    ASSERT_TRUE(mission) << ToString(mission.error());
    EXPECT_EQ(mission->images.size(), 2u) << cut;
    EXPECT_FALSE(ReadImageTimes(table) && ReadImageTimes(table)->size() == 2u) << cut;
  }
  ASSERT_TRUE(WriteFileAtomically(table, ""));  // power went before the header was there
  const auto mission = ReadMission(folder_.path());
  ASSERT_TRUE(mission) << ToString(mission.error());
  EXPECT_TRUE(mission->images.empty());
}

TEST_F(MissionTest, TheIndexOfWaterIsThatOfTheTime) {
  Rig rig = SampleRig();
  rig.camera.port.type = PortType::kFlat;
  rig.camera.port.index_water = 1.3;
  {
    auto writer = MissionWriter::Create(folder_.path(), rig);
    ASSERT_TRUE(writer);
    for (const auto& [utime, index] :
         {std::pair{1000, 1.34}, std::pair{2000, 1.341}, std::pair{3000, std::nan("")}}) {
      water_t water = {};
      water.utime = utime;
      water.index_water = index;
      water.is_measured = true;
      ASSERT_TRUE(writer->Log("RSFM_WATER", utime, water));
    }
    ASSERT_TRUE(writer->Close());
  }
  const auto mission = ReadMission(folder_.path());
  ASSERT_TRUE(mission);
  EXPECT_EQ(mission->waters.size(), 3u);
  EXPECT_EQ(mission->IndexWaterAt(999), 1.3);  // the rig's
  EXPECT_EQ(mission->IndexWaterAt(1000), 1.34);
  EXPECT_EQ(mission->IndexWaterAt(2999), 1.341);
  EXPECT_EQ(mission->IndexWaterAt(3001), 1.341);  // what is not finite is not believed
}

TEST_F(MissionTest, MessagesOfAnotherTypeAreCounted) {
  Rig rig = SampleRig();
  rig.bus.pose_channel = "RSFM_KEYFRAME";
  rig.bus.keyframe_channel = "OTHER";
  ASSERT_TRUE(WriteRig(rig, folder_.path() / kRigFile));
  const auto mission = ReadMission(folder_.path());
  ASSERT_TRUE(mission);
  EXPECT_EQ(mission->num_malformed, 2);
}

TEST_F(MissionTest, AFolderWithoutARigIsNoMission) {
  fs::remove(folder_.path() / kRigFile);
  const auto mission = ReadMission(folder_.path());
  ASSERT_FALSE(mission);
  EXPECT_EQ(ExitCode(mission.error()), 2);
}

}  // namespace
}  // namespace rsfm

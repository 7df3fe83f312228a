// Navigation and image-time tables: round trips, and each way in which one can be wrong.
#include "rsfm/io/tables.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "rsfm/io/atomic_output.h"
#include "tests/support/temporary_folder.h"

namespace rsfm {
namespace {

using ::testing::HasSubstr;

class TablesTest : public ::testing::Test {
 protected:
  TemporaryFolder folder_;
  std::filesystem::path path_ = folder_.path() / "nav.csv";

  IoExpected<NavTable> Read(const std::string& text, const std::vector<ImageTime>& images = {}) {
    EXPECT_TRUE(WriteFileAtomically(path_, text));
    return ReadNavTable(path_, images);
  }
};

TEST_F(TablesTest, WhatIsWrittenReadsBack) {
  NavSample full;
  full.utime = 1000;
  full.valid = 63;
  full.position_ned_m = {1.0 / 3, -2, 3};
  full.ned_from_body = QuatFromRollPitchHeading(0.1, -0.2, 3.0);
  full.velocity_body_mps = {0.1, 0.2, 0.3};
  full.depth_m = 3.3;
  full.altitude_m = 1.2;
  full.temperature_c = 8;
  full.salinity_psu = 35;
  full.sigma_position_m = {1, 2, 3};
  full.sigma_attitude_rad = {0.01, 0.02, 0.03};
  full.sigma_depth_m = 0.05;
  NavSample depth_only;
  depth_only.utime = 2000;
  depth_only.Set(NavField::kDepth);
  depth_only.depth_m = 4.4;
  ASSERT_TRUE(WriteNavTable({full, depth_only}, path_));
  const auto back = ReadNavTable(path_);
  ASSERT_TRUE(back) << ToString(back.error());
  ASSERT_EQ(back->samples.size(), 2u);
  const NavSample& s = back->samples[0];
  EXPECT_EQ(s.utime, 1000);
  EXPECT_EQ(s.valid, 63u);
  EXPECT_EQ(s.position_ned_m, full.position_ned_m);
  EXPECT_LT(s.ned_from_body.angularDistance(full.ned_from_body), 1e-12);
  EXPECT_EQ(s.velocity_body_mps, full.velocity_body_mps);
  EXPECT_EQ(s.sigma_position_m, full.sigma_position_m);
  EXPECT_EQ(s.sigma_attitude_rad, full.sigma_attitude_rad);
  EXPECT_EQ(s.sigma_depth_m, 0.05);
  EXPECT_EQ(s.temperature_c, 8);
  EXPECT_EQ(back->samples[1].valid, static_cast<std::uint32_t>(NavField::kDepth));
  EXPECT_EQ(back->samples[1].depth_m, 4.4);
}

TEST_F(TablesTest, RollPitchHeadingAreFrdInNed) {
  const Quat q = QuatFromRollPitchHeading(0.1, 0.2, 0.3);
  EXPECT_LT((RollPitchHeading(q) - Vec3(0.1, 0.2, 0.3)).norm(), 1e-12);
  // Heading east: forward is east. Nose up: forward points up.
  EXPECT_LT((QuatFromRollPitchHeading(0, 0, M_PI / 2) * Vec3::UnitX() - Vec3::UnitY()).norm(),
            1e-12);
  EXPECT_LT((QuatFromRollPitchHeading(0, M_PI / 2, 0) * Vec3::UnitX() + Vec3::UnitZ()).norm(),
            1e-12);
}

TEST_F(TablesTest, LatitudesBecomeNedAtTheFirst) {
  const auto table = Read(
      "utime,latitude_deg,longitude_deg,height_m,sigma_latitude_deg\n"
      "1,54,10,5,0.00001\n2,54.001,10,3,\n");
  ASSERT_TRUE(table) << ToString(table.error());
  ASSERT_TRUE(table->origin);
  EXPECT_EQ(table->origin->height_m, 5);
  EXPECT_LT(table->samples[0].position_ned_m.norm(), 1e-9);
  EXPECT_NEAR(table->samples[0].sigma_position_m.x(), 1.113, 0.01);
  EXPECT_NEAR(table->samples[1].position_ned_m.x(), 111.3, 0.1);
  EXPECT_NEAR(table->samples[1].position_ned_m.z(), 2.0, 0.01);
}

TEST_F(TablesTest, ImagesGiveTheTime) {
  const auto table = Read("image,depth_m\nb.jpg,2\nc.jpg,3\n", {{"b.jpg", 20}, {"c.jpg", 30}});
  ASSERT_TRUE(table) << ToString(table.error());
  EXPECT_EQ(table->samples[1].utime, 30);
}

constexpr const char* kColmapUnderwaterHeader =
    "DateTime [%Y-%m-%d %H:%M:%S.%f],Latitude [deg],Longitude [deg],Altitude [m],Depth [m],"
    "North SD [m],East SD [m],Depth SD [m],Yaw [rad],Pitch [rad],Roll [rad],Yaw SD [rad],"
    "Pitch SD [rad],Roll SD [rad]\n";

// Its names, its date, sigmas of the place in metres.
TEST_F(TablesTest, ColmapUnderwatersNavigation) {
  const auto table = Read(std::string(kColmapUnderwaterHeader) +
                          "2019-05-17 08:03:21.250,54,10,2.5,100,0.3,0.4,0.05,1.5,0.1,-0.2,0.02,"
                          "0.01,0.01\n"
                          "2019-05-17 08:03:22,54.001,10,2.5,101,,,,1.5,0.1,-0.2,,,\n");
  ASSERT_TRUE(table) << ToString(table.error());
  ASSERT_EQ(table->samples.size(), 2u);
  const NavSample& first = table->samples[0];
  EXPECT_EQ(first.utime, 1558080201250000);  // date -u -d '2019-05-17 08:03:21' +%s
  EXPECT_EQ(table->samples[1].utime, 1558080202000000);
  EXPECT_EQ(table->origin->latitude_deg, 54.0);
  EXPECT_LT((first.position_ned_m - Vec3(0, 0, 100)).norm(), 1e-9);
  EXPECT_NEAR(table->samples[1].position_ned_m.x(), 111.3, 0.1);
  EXPECT_EQ(table->samples[1].position_ned_m.z(), 101.0);
  EXPECT_EQ(first.sigma_position_m, Vec3(0.3, 0.4, 0.05));
  EXPECT_EQ(table->samples[1].sigma_position_m, Vec3::Zero());  // not stated
  EXPECT_LT(first.ned_from_body.angularDistance(QuatFromRollPitchHeading(-0.2, 0.1, 1.5)), 1e-12);
  EXPECT_GE(first.sigma_attitude_rad.z(), 0.02);
  EXPECT_EQ(first.altitude_m, 2.5);
  EXPECT_EQ(first.depth_m, 100.0);
  EXPECT_EQ(first.sigma_depth_m, 0.05);
}

// As that program wants it: a file for each image, whose own time counts.
TEST_F(TablesTest, AFolderHasAFileForEachImage) {
  const auto nav = folder_.path() / "nav";
  std::filesystem::create_directories(nav / "dive");
  const std::string row = "2019-05-17 08:03:21.250,54,10,2.5,100,1,1,1,0,0,0,1,1,1\n";
  ASSERT_TRUE(WriteFileAtomically(nav / "dive" / "b.csv", kColmapUnderwaterHeader + row));
  const std::vector<ImageTime> images = {{"a.jpg", 10}, {"dive/b.jpg", 20}};
  const auto table = ReadNavTable(nav, images);
  ASSERT_TRUE(table) << ToString(table.error());
  ASSERT_EQ(table->samples.size(), 1u);
  EXPECT_EQ(table->samples[0].utime, 20);
  EXPECT_EQ(table->samples[0].depth_m, 100.0);

  const auto none = ReadNavTable(nav, {{"a.jpg", 10}});
  ASSERT_FALSE(none);
  EXPECT_THAT(none.error().problem, HasSubstr("no navigation of any of the 1 images"));
  EXPECT_EQ(ExitCode(none.error()), 2);
  ASSERT_TRUE(WriteFileAtomically(nav / "a.csv", kColmapUnderwaterHeader + row + row));
  const auto two = ReadNavTable(nav, images);
  ASSERT_FALSE(two);
  EXPECT_EQ(two.error().file, (nav / "a.csv").string());
  EXPECT_THAT(two.error().problem, HasSubstr("has 2 rows"));
}

TEST_F(TablesTest, AnEmptyFieldIsNotMeasured) {
  const auto table = Read("utime,vx_mps,vy_mps,vz_mps,depth_m\n1,0.1,,0.2,5\n2,,,,\n");
  ASSERT_TRUE(table) << ToString(table.error());
  ASSERT_EQ(table->samples.size(), 1u);
  EXPECT_FALSE(table->samples[0].Has(NavField::kVelocity));
  EXPECT_TRUE(table->samples[0].Has(NavField::kDepth));
}

struct BadTable {
  const char* name;
  const char* text;
  int line;
  const char* field;
  const char* problem;
  const char* fix;
};
void PrintTo(const BadTable& bad, std::ostream* out) { *out << bad.name; }

class BadNavTableTest : public TablesTest, public ::testing::WithParamInterface<BadTable> {};

TEST_P(BadNavTableTest, NamesFileLineColumnAndFix) {
  const BadTable& bad = GetParam();
  const auto table = Read(bad.text);
  ASSERT_FALSE(table);
  EXPECT_EQ(table.error().file, path_.string());
  EXPECT_EQ(table.error().line, bad.line);
  EXPECT_THAT(table.error().field, ::testing::StartsWith(bad.field));
  EXPECT_THAT(table.error().problem, HasSubstr(bad.problem));
  EXPECT_THAT(table.error().fix, HasSubstr(bad.fix));
  EXPECT_EQ(ExitCode(table.error()), 2);
}

INSTANTIATE_TEST_SUITE_P(
    All, BadNavTableTest,
    ::testing::Values(
        BadTable{"Empty", "", 0, "", "is empty", "header"},
        BadTable{"UnknownColumn", "utime,deepth_m\n1,2\n", 1, "column 'deepth_m'", "not known",
                 "did you mean 'depth_m'"},
        BadTable{"ColumnTwice", "utime,depth_m,depth_m\n1,2,3\n", 1, "column 'depth_m'", "twice",
                 "keep one"},
        BadTable{"NoTime", "depth_m\n2\n", 1, "column utime", "missing", "utime"},
        BadTable{"SigmaAlone", "utime,sigma_depth_m\n1,2\n", 1, "column sigma_depth_m",
                 "without the column", "add"},
        BadTable{"HalfAGroup", "utime,vx_mps,vy_mps\n1,2,3\n", 1, "column vz_mps", "missing",
                 "add"},
        BadTable{"NoVertical", "utime,north_m,east_m\n1,2,3\n", 1, "column down_m", "missing",
                 "depth_m"},
        BadTable{"RunsBackwards", "utime,depth_m\n5,2\n4,2\n", 3, "column utime", "backwards",
                 "sort"},
        BadTable{"NaN", "utime,depth_m\n1,2\n2,nan\n", 3, "column depth_m", "not finite",
                 "leave the field empty"},
        BadTable{"Infinite", "utime,depth_m\n1,-inf\n", 2, "column depth_m", "not finite", "empty"},
        BadTable{"NotANumber", "utime,depth_m\n1,deep\n", 2, "column depth_m", "not a number",
                 "number"},
        BadTable{"TimeInSeconds", "utime,depth_m\n1.5,2\n", 2, "column utime",
                 "no time in whole microseconds", "microseconds"},
        BadTable{"TimeBeyondAllClocks", "utime,depth_m\n-9223372036854775808,2\n", 2,
                 "column utime", "no time in whole microseconds", "microseconds"},
        BadTable{"DvlSentinel", "utime,vx_mps,vy_mps,vz_mps\n1,-32.768,-32.768,-32.768\n", 2,
                 "column vx_mps", "out of range: -32.768", "leave the field empty"},
        BadTable{"Latitude", "utime,latitude_deg,longitude_deg,height_m\n1,95,10,0\n", 2,
                 "column latitude_deg", "out of range", "-90 to 90"},
        BadTable{"NegativeSigma", "utime,depth_m,sigma_depth_m\n1,2,-1\n", 2,
                 "column sigma_depth_m", "out of range", "0 or more"},
        BadTable{"NotUnit", "utime,qw,qx,qy,qz\n1,0.5,0,0,0\n", 2, "column qw", "length is 0.5",
                 "unit quaternion"},
        BadTable{"MissingField", "utime,depth_m\n1\n", 2, "", "1 fields", "each column"},
        BadTable{"NoDate", "DateTime [%Y-%m-%d %H:%M:%S.%f],Depth [m]\n2019-02-29 08:03:21,2\n", 2,
                 "column DateTime", "no date with a time", "UTC"},
        BadTable{"DateWithoutTime", "DateTime [%Y-%m-%d %H:%M:%S.%f],depth_m\n2019-02-28,2\n", 2,
                 "column DateTime", "no date with a time", "UTC"},
        BadTable{"BothNames", "utime,Depth [m],depth_m\n1,2,3\n", 1, "column 'depth_m'",
                 "twice, once as 'Depth [m]'", "keep one"},
        BadTable{"TwoTimes", "utime,DateTime [%Y-%m-%d %H:%M:%S.%f],depth_m\n1,2,3\n", 1,
                 "column utime", "beside the column DateTime", "either"},
        BadTable{"MetresBesideDegrees",
                 "utime,latitude_deg,longitude_deg,height_m,sigma_latitude_deg,sigma_north_m\n"
                 "1,54,10,0,1e-5,1\n",
                 1, "column sigma_north_m", "without the column", "add"},
        BadTable{"UnknownImage", "image,depth_m\nx.jpg,2\n", 2, "column image",
                 "'x.jpg' is not among the images", "name"}),
    [](const auto& test) { return std::string(test.param.name); });

TEST_F(TablesTest, ImageTimes) {
  const std::vector<ImageTime> images = {{"a.jpg", 1}, {"b c.jpg", 2}};
  ASSERT_TRUE(WriteImageTimes(images, path_));
  const auto back = ReadImageTimes(path_);
  ASSERT_TRUE(back);
  ASSERT_EQ(back->size(), 2u);
  EXPECT_EQ((*back)[1].image, "b c.jpg");
  EXPECT_EQ((*back)[1].utime, 2);
  for (const char* bad : {"image,utime\na,1\nb,1\n", "image,utime\na,1\na,2\n",
                          "image,utime\na,x\n", "image,time\na,1\n", "image,utime\n,1\n"}) {
    ASSERT_TRUE(WriteFileAtomically(path_, bad));
    EXPECT_FALSE(ReadImageTimes(path_)) << bad;
  }
  EXPECT_FALSE(WriteImageTimes({{"a,b.jpg", 1}}, path_));
}

}  // namespace
}  // namespace rsfm

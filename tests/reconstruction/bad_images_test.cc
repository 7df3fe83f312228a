// rsfm_tool reconstruct, end to end on small images, whole and with what goes wrong in practice: a
// result that says what it could and could not do, or an error that names the cause.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "rsfm/base/rng.h"
#include "rsfm/io/atomic_output.h"
#include "rsfm/io/rig.h"
#include "rsfm/io/tables.h"
#include "tests/support/run_program.h"

namespace rsfm {
namespace {

namespace fs = std::filesystem;
using ::testing::AnyOf;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr const char* kScenario = R"(seed: 7
rig:
  camera: {model: PINHOLE, width: 320, height: 240, params: [256, 256, 160, 120]}
  port: {type: flat, normal: [0, 0, 1], distance_m: 0.03, thickness_m: 0.01, index_air: 1.0, index_glass: 1.52,
         index_water: 1.336}
  body_from_camera: {rotation_wxyz: [0.7071067811865476, 0, 0, 0.7071067811865476], translation_m: [0.4, 0.05, 0.15]}
images: {format: png}
trajectory: {legs: 1, leg_length_m: 4.0, altitude_m: 1.6, speed_mps: 0.35}
seafloor: {depth_m: 20.0}
navigation: {position: {enabled: true, rate_hz: 5.0, horizontal_sigma_m: 0.02, vertical_sigma_m: 0.02}}
)";
constexpr int kNumImages = 7;

// One mission for all tests; each works on a copy of its images.
class BadImagesTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    mission_ = new TemporaryFolder;
    const fs::path folder = mission_->path();
    ASSERT_TRUE(WriteFileAtomically(folder / "scenario.yaml", kScenario));
    const ProgramResult result = RunProgram(
        std::string(RSFM_TOOL) + " simulate " + (folder / "scenario.yaml").string() + " --images " +
        std::to_string(kNumImages) + " --out " + (folder / "mission").string());
    ASSERT_EQ(result.exit_code, 0) << result.err;
  }
  static void TearDownTestSuite() {
    delete mission_;
    mission_ = nullptr;
  }

  void SetUp() override { fs::copy(Mission() / "images", Path("images")); }
  static fs::path Mission() { return mission_->path() / "mission"; }
  fs::path Path(const std::string& name) const { return folder_.path() / name; }
  fs::path Image(int i) const {
    char name[32];
    std::snprintf(name, sizeof name, "images/%06d.png", i);
    return Path(name);
  }

  ProgramResult Reconstruct(const std::string& more = {}) const {
    return RunProgram(std::string(RSFM_TOOL) + " reconstruct " + Path("images").string() +
                      " --camera " + (Mission() / "rig.yaml").string() + " --out " +
                      Path("model").string() + " --work " + Path("work").string() + " " + more);
  }
  nlohmann::json ReadReport() const {
    std::ifstream file(Path("model/report.json"));
    return nlohmann::json::parse(file);
  }

  static TemporaryFolder* mission_;
  TemporaryFolder folder_;
};
TemporaryFolder* BadImagesTest::mission_ = nullptr;

TEST_F(BadImagesTest, GoodImagesAndNavigationGiveAMetricModel) {
  const ProgramResult result = Reconstruct("--times " + (Mission() / "images.csv").string() +
                                           " --nav " + (Mission() / "nav.csv").string());
  ASSERT_EQ(result.exit_code, 0) << result.err;
  const auto report = ReadReport();
  EXPECT_EQ(report["models"].size(), 1u);
  EXPECT_EQ(report["models"][0]["images"], kNumImages);
  EXPECT_EQ(report["models"][0]["scale"], "navigation");
  EXPECT_EQ(report["models"][0]["frame"], "NED");
  EXPECT_TRUE(report["warnings"].empty()) << report["warnings"];
  const ProgramResult evaluation =
      RunProgram(std::string(RSFM_TOOL) + " evaluate " + Path("model").string() + " " +
                 (Mission() / "ground_truth").string() + " --align se3 --json");
  ASSERT_EQ(evaluation.exit_code, 0) << evaluation.err;
  EXPECT_LT(nlohmann::json::parse(evaluation.out)["position_error_mm"].get<double>(), 20.0);
  EXPECT_TRUE(nlohmann::json::parse(evaluation.out)["navigation"].is_null());

  const ProgramResult with_nav =
      RunProgram(std::string(RSFM_TOOL) + " evaluate " + Path("model").string() + " " +
                 (Mission() / "ground_truth").string() + " --align yaw --json --nav " +
                 (Mission() / "nav.csv").string());
  ASSERT_EQ(with_nav.exit_code, 0) << with_nav.err;
  const auto json = nlohmann::json::parse(with_nav.out);
  EXPECT_LT(json["position_error_mm"].get<double>(), 60.0);
  EXPECT_EQ(json["navigation"]["positions"], kNumImages);
  EXPECT_LT(json["navigation"]["position_rms_m"].get<double>(), 0.1);
  EXPECT_TRUE(json["bend"].is_object());
}

// Views of things that all move, each on a way of its own: fish, weed, snow.
TEST_F(BadImagesTest, ImagesInWhichNothingStandsStillAreRefused) {
  Rng rng(11);
  std::vector<cv::Mat> things;
  for (int i = 0; i < 40; ++i) {
    cv::Mat thing(8, 8, CV_8U);
    for (int row = 0; row < thing.rows; ++row)
      for (int column = 0; column < thing.cols; ++column)
        thing.at<std::uint8_t>(row, column) = static_cast<std::uint8_t>(rng.Index(256));
    cv::resize(thing, thing, cv::Size(28, 28), 0, 0, cv::INTER_CUBIC);
    things.push_back(thing);
  }
  for (int i = 0; i < kNumImages; ++i) {
    cv::Mat image(240, 320, CV_8U, cv::Scalar(60));
    for (const cv::Mat& thing : things)
      thing.copyTo(image(cv::Rect(rng.Index(320 - 28), rng.Index(240 - 28), 28, 28)));
    cv::imwrite(Image(i).string(), image);
  }
  const ProgramResult result = Reconstruct();
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_THAT(result.err, AnyOf(HasSubstr("show nothing that stands still"),
                                HasSubstr("hold no pair to begin with")));
  EXPECT_FALSE(fs::exists(Path("model")));
}

TEST_F(BadImagesTest, DamagedDuplicateTurnedAndResizedImagesAreLeftOutAndNamed) {
  fs::copy_file(Image(0), Path("images/copy.png"));
  ASSERT_TRUE(WriteFileAtomically(Path("images/damaged.png"), "not a picture"));
  const cv::Mat image = cv::imread(Image(1).string());
  cv::Mat turned, smaller;
  cv::rotate(image, turned, cv::ROTATE_90_CLOCKWISE);
  cv::resize(image, smaller, cv::Size(160, 120));
  cv::imwrite(Path("images/turned.png").string(), turned);
  cv::imwrite(Path("images/smaller.png").string(), smaller);
  fs::resize_file(Image(6), fs::file_size(Image(6)) / 2);
  const ProgramResult result = Reconstruct();
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_THAT(result.err, HasSubstr("5 image(s) left out"));
  const auto report = ReadReport();
  EXPECT_EQ(report["models"][0]["images"], kNumImages - 1);
  std::map<std::string, std::string> reasons;
  for (const auto& left_out : report["images"]["left_out"])
    reasons[left_out["image"]] = left_out["reason"];
  EXPECT_EQ(reasons.size(), 5u);
  EXPECT_THAT(reasons["copy.png"], HasSubstr("is the same file as"));
  EXPECT_THAT(reasons["damaged.png"], HasSubstr("not an image"));
  EXPECT_THAT(reasons["turned.png"], HasSubstr("240 x 320"));
  EXPECT_THAT(reasons["smaller.png"], HasSubstr("160 x 120"));
  EXPECT_THAT(reasons["000006.png"], HasSubstr("cut off"));
}

TEST_F(BadImagesTest, ImagesWithoutOverlapAreRefused) {
  for (int i = 0; i < kNumImages; ++i) {
    Rng rng(static_cast<std::uint64_t>(i) + 1);
    cv::Mat noise(240, 320, CV_8UC1);
    for (int k = 0; k < 240 * 320; ++k) noise.data[k] = static_cast<unsigned char>(rng.Index(256));
    cv::GaussianBlur(noise, noise, cv::Size(0, 0), 2.0);
    cv::normalize(noise, noise, 0, 255, cv::NORM_MINMAX);
    cv::imwrite(Image(i).string(), noise);
  }
  const ProgramResult result = Reconstruct();
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_THAT(result.err, HasSubstr("do not overlap: 0 of 21 pairs"));
  EXPECT_FALSE(fs::exists(Path("model")));
}

TEST_F(BadImagesTest, ImagesOfOnePlaceOnlyAreRefused) {
  const cv::Mat image = cv::imread(Image(2).string());
  for (int i = 0; i < kNumImages; ++i) {
    cv::Mat noisy = image.clone();
    cv::RNG rng(static_cast<std::uint64_t>(i) + 1);
    cv::Mat noise(image.size(), CV_8UC3);
    rng.fill(noise, cv::RNG::UNIFORM, 0, 4);
    cv::add(noisy, noise, noisy);
    cv::imwrite(Image(i).string(), noisy);
  }
  const ProgramResult result = Reconstruct();
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_THAT(result.err, HasSubstr("hold no pair to begin with"));
  EXPECT_THAT(result.err, HasSubstr("parallax"));
}

TEST_F(BadImagesTest, NavigationAnHourOffIsNotUsedAndSaidSo) {
  auto table = ReadNavTable(Mission() / "nav.csv");
  ASSERT_TRUE(table);
  for (NavSample& sample : table->samples) sample.utime += 3'600'000'000;
  ASSERT_TRUE(WriteNavTable(table->samples, Path("nav.csv")));
  const ProgramResult result = Reconstruct("--times " + (Mission() / "images.csv").string() +
                                           " --nav " + Path("nav.csv").string());
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_THAT(result.err, HasSubstr("navigation is not used"));
  EXPECT_THAT(result.err, HasSubstr("no image lies within"));
  EXPECT_NE(ReadReport()["models"][0]["scale"], "navigation");
}

TEST_F(BadImagesTest, NavigationWithAnotherFrameOfTheBodyIsNotUsedAndSaidSo) {
  auto table = ReadNavTable(Mission() / "nav.csv");
  ASSERT_TRUE(table);
  // Positions east-north-up under attitudes that are north-east-down, and no velocities.
  for (NavSample& sample : table->samples) {
    const Vec3 p = sample.position_ned_m;
    sample.position_ned_m = Vec3(p.y(), p.x(), -p.z());
    sample.sigma_position_m = Vec3::Constant(0.02);
    sample.Clear(NavField::kVelocity);
    sample.Clear(NavField::kDepth);
  }
  ASSERT_TRUE(WriteNavTable(table->samples, Path("nav.csv")));
  const ProgramResult result = Reconstruct("--times " + (Mission() / "images.csv").string() +
                                           " --nav " + Path("nav.csv").string());
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_THAT(result.err, HasSubstr("navigation is not used: positions differ"));
}

TEST_F(BadImagesTest, ARunThatIsKilledContinues) {
  const ProgramResult killed = RunProgram(
      "timeout -s KILL 1.5 " + std::string(RSFM_TOOL) + " reconstruct " + Path("images").string() +
      " --camera " + (Mission() / "rig.yaml").string() + " --out " + Path("model").string() +
      " --work " + Path("work").string() + " --threads 1");
  // Wherever that was: the next run uses what is there and ends well.
  const ProgramResult result = Reconstruct("--threads 1");
  ASSERT_EQ(result.exit_code, 0) << result.err << killed.err;
  EXPECT_EQ(ReadReport()["models"][0]["images"], kNumImages);
  const ProgramResult again = Reconstruct("--threads 1");
  ASSERT_EQ(again.exit_code, 0);
  EXPECT_EQ(ReadReport()["seconds"]["features_from_cache"], kNumImages);
}

TEST_F(BadImagesTest, ALensWrongByTenPercentIsWorseThanTheRightOneAndIsMended) {
  ASSERT_EQ(Reconstruct().exit_code, 0);
  const double right = ReadReport()["models"][0]["rms_error_px"];
  std::string rig = *ReadWholeFile(Mission() / "rig.yaml");
  const std::size_t at = rig.find("256");
  ASSERT_NE(at, std::string::npos);
  rig.replace(at, 3, "282");  // fx alone: no scene explains that
  ASSERT_TRUE(WriteFileAtomically(Path("wrong.yaml"), rig));
  std::string warnings;
  const auto reconstruct_wrong = [&](const std::string& more) {
    const ProgramResult result =
        RunProgram(std::string(RSFM_TOOL) + " reconstruct " + Path("images").string() +
                   " --camera " + Path("wrong.yaml").string() + " --out " + Path("model").string() +
                   " --work " + Path("work").string() + more);
    EXPECT_EQ(result.exit_code, 0) << result.err;
    warnings = result.err;
    return ReadReport()["models"][0]["rms_error_px"].get<double>();
  };
  const double wrong = reconstruct_wrong("");
  EXPECT_GT(wrong, 1.05 * right);
  EXPECT_THAT(warnings, HasSubstr("the images contradict the camera file: fx is 282"));

  const double refined = reconstruct_wrong(" --refine-lens");
  EXPECT_THAT(warnings, Not(HasSubstr("contradict the camera file")));
  EXPECT_LT(refined, 1.02 * right);
  const auto model = ParseRig(*ReadWholeFile(Path("model/rig.yaml")), "rig.yaml");
  ASSERT_TRUE(model);
  const auto& params = model->camera.lens_params;
  EXPECT_NEAR(params[0] / params[1], 1.0, 0.02);  // 1.1 in the wrong one
}

}  // namespace
}  // namespace rsfm

// The two public sequences, through the on-board mapper alone.
#include <gtest/gtest.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include "tests/support/run_program.h"
#include "tests/support/temporary_folder.h"
#include "tools/map/map_images.h"

namespace rsfm {
namespace {

namespace fs = std::filesystem;

const fs::path kData = fs::path(RSFM_SHARED_DATA) / "data";

MapRequest Request(const fs::path& images, const char* rig, double fps, const fs::path& out) {
  MapRequest request;
  request.images = images;
  request.rig = fs::path(RSFM_RIGS) / rig;
  request.fps = fps;
  request.out = out;
  return request;
}

TEST(RealSequences, WhitepointIsOneMap) {
  if (!fs::exists(kData / "whitepoint"))
    GTEST_SKIP() << kData / "whitepoint"
                 << " is absent";
  const TemporaryFolder folder;
  const auto result =
      MapImages(Request(kData / "whitepoint", "whitepoint.yaml", 3.0, folder.path() / "out"));
  ASSERT_TRUE(result.has_value()) << ToString(result.error());
  EXPECT_EQ(result->num_images, 20);
  EXPECT_EQ(result->num_placed, 20);
  EXPECT_EQ(result->num_resets, 0);
  EXPECT_FALSE(result->scale_is_metric);
  EXPECT_LT(result->mean_error_px, 1.3);
}

TEST(RealSequences, SubvoIsOneMapAndTrue) {
  if (!fs::exists(kData / "subvo"))
    GTEST_SKIP() << kData / "subvo"
                 << " is absent";
  const TemporaryFolder folder;
  const fs::path out = folder.path() / "out";
  const auto result = MapImages(Request(kData / "subvo" / "images", "subvo.yaml", 0.5, out));
  ASSERT_TRUE(result.has_value()) << ToString(result.error());
  EXPECT_EQ(result->num_images, 110);
  EXPECT_GE(result->num_placed, 105);
  EXPECT_EQ(result->num_resets, 0);
  const auto evaluated =
      RunProgram(std::string(RSFM_TOOL) + " evaluate " + out.string() + " " +
                 (kData / "subvo" / "ground_truth.csv").string() + " --align sim3 --json");
  ASSERT_EQ(evaluated.exit_code, 0) << evaluated.err;
  const auto json = nlohmann::json::parse(evaluated.out);
  EXPECT_GE(json["images"].get<int>(), 105);
  EXPECT_LT(json["position_rmse_mm"].get<double>(), 200.0);
}

}  // namespace
}  // namespace rsfm

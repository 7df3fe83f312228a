#include "rsfm/mapping/mapper_options.h"

#include <gtest/gtest.h>

#include <limits>
#include <string>
#include <type_traits>

namespace rsfm {
namespace {

TEST(MapperOptions, DefaultsAreValid) { EXPECT_TRUE(MapperOptions{}.Validate().has_value()); }

TEST(MapperOptions, EveryNumberIsCheckedByName) {
  const MapperOptions defaults;
  ForEachOption(defaults, [](const char* name, const auto& value) {
    using T = std::decay_t<decltype(value)>;
    if constexpr (std::is_same_v<T, double> || std::is_same_v<T, int>) {
      MapperOptions bad;
      ForEachOption(bad, [&](const char* other, auto& member) {
        if constexpr (std::is_same_v<std::decay_t<decltype(member)>, T>) {
          if (std::string(name) != other) return;
          if constexpr (std::is_same_v<T, double>) {
            member = std::numeric_limits<double>::quiet_NaN();
          } else {
            member = -1000;
          }
        }
      });
      const Status status = bad.Validate();
      ASSERT_FALSE(status.has_value()) << name;
      EXPECT_STREQ(status.error().where, name);
    }
  });
}

TEST(MapperOptions, ValuesThatAreNoneHaveNoName) {
  EXPECT_EQ(ToString(Rhythm::kVideo), "video");
  EXPECT_EQ(ToString(DescriptorType::kAkaze), "akaze");
  for (const int value : {2, 4, 15, 255}) {
    EXPECT_EQ(ToString(static_cast<Rhythm>(value)), "") << value;
    if (value == 2) continue;
    EXPECT_EQ(ToString(static_cast<DescriptorType>(value)), "") << value;
    EXPECT_EQ(DescriptorBytes(static_cast<DescriptorType>(value)), 0) << value;
  }
}

TEST(MapperOptions, RefusesContradictions) {
  MapperOptions options;
  options.mask.TryPushBack({10, 10, 10, 20});
  EXPECT_STREQ(options.Validate().error().where, "mask");
  options = {};
  options.window_keyframes = 15;
  options.max_keyframes = 16;
  EXPECT_STREQ(options.Validate().error().where, "window_keyframes");
  options.window_keyframes = 14;
  EXPECT_TRUE(options.Validate().has_value());
  options = {};
  options.max_places = 100;
  options.max_way_nodes = 99;
  EXPECT_STREQ(options.Validate().error().where, "max_places");
  options = {};
  options.track_window_px = 20;
  EXPECT_STREQ(options.Validate().error().where, "track_window_px");
  options = {};
  options.descriptor = DescriptorType::kNone;
  EXPECT_STREQ(options.Validate().error().where, "descriptor");
}

TEST(MapperOptions, NamesAndBack) {
  for (const DescriptorType type : {DescriptorType::kNone, DescriptorType::kOrb,
                                    DescriptorType::kSift, DescriptorType::kAkaze}) {
    DescriptorType again = DescriptorType::kNone;
    EXPECT_TRUE(FromString(ToString(type), &again));
    EXPECT_EQ(again, type);
  }
  Rhythm rhythm = Rhythm::kStills;
  EXPECT_TRUE(FromString("video", &rhythm));
  EXPECT_EQ(rhythm, Rhythm::kVideo);
  EXPECT_FALSE(FromString("film", &rhythm));
}

}  // namespace
}  // namespace rsfm

#include "rsfm/navigation/repeat_watch.h"

#include <gtest/gtest.h>

#include <cmath>

#include "rsfm/base/rng.h"

namespace rsfm {
namespace {

// Values of one sensor, a second apart.
class Sensor {
 public:
  bool Send(double value) { return watch_.Take(++utime_, Vec4(value, 0, 0, 0)); }
  bool SendAgain(double value) { return watch_.Take(utime_, Vec4(value, 0, 0, 0)); }
  // How many of `count` equal values are taken before the first refused one.
  int Freeze(double value, int count) {
    int taken = 0;
    while (taken < count && Send(value)) ++taken;
    return taken;
  }

 private:
  RepeatWatch watch_;
  Utime utime_ = 0;
};

TEST(RepeatWatch, AValueThatNeverRepeatedMayNotRepeatForLong) {
  Rng rng(1);
  Sensor sensor;
  double value = 0.0;
  for (int i = 0; i < 1000; ++i) ASSERT_TRUE(sensor.Send(value = rng.Gaussian())) << i;
  EXPECT_EQ(sensor.Freeze(value, 100), 3);
  for (int i = 0; i < 1000; ++i) ASSERT_FALSE(sensor.Send(value)) << i;
  EXPECT_TRUE(sensor.Send(1.0));  // back
  EXPECT_TRUE(sensor.Send(1.1));
}

TEST(RepeatWatch, TheFewerItHasSeenTheLongerItWaits) {
  Rng rng(2);
  Sensor sensor;
  for (int i = 0; i < 10; ++i) ASSERT_TRUE(sensor.Send(rng.Gaussian())) << i;
  const int taken = sensor.Freeze(0.5, 100);
  EXPECT_GT(taken, 10);
  EXPECT_LT(taken, 40);
}

// On deck, in a tank, or a simulator without noise.
TEST(RepeatWatch, AValueThatHasNeverChangedIsTaken) {
  Sensor sensor;
  EXPECT_EQ(sensor.Freeze(0.0, 100'000), 100'000);
}

// The noise is a third of the resolution, and the vehicle holds its depth, for half an hour at 10
// Hz.
TEST(RepeatWatch, ACoarseSensorIsKnownForOne) {
  Rng rng(3);
  Sensor sensor;
  for (int i = 0; i < 18'000; ++i) {
    const double depth_m = 5.0 + 0.004 * std::sin(0.05 * i) + 0.003 * rng.Gaussian();
    ASSERT_TRUE(sensor.Send(0.01 * std::round(depth_m / 0.01))) << i;
  }
}

// A depth of once a second in messages of ten a second.
TEST(RepeatWatch, ASlowSensorOnAFastBusIsKnownForOne) {
  Rng rng(4);
  Sensor sensor;
  double value = 0.0;
  for (int i = 0; i < 18'000; ++i) {
    if (i % 10 == 0) value = rng.Gaussian();
    ASSERT_TRUE(sensor.Send(value)) << i;
  }
  EXPECT_LT(sensor.Freeze(value, 1000), 300);
}

TEST(RepeatWatch, TheSameMessageTwiceIsNoRepetition) {
  Rng rng(5);
  Sensor sensor;
  double value = 0.0;
  for (int i = 0; i < 1000; ++i) {
    ASSERT_TRUE(sensor.Send(value = rng.Gaussian())) << i;
    ASSERT_TRUE(sensor.SendAgain(value)) << i;
  }
  EXPECT_EQ(sensor.Freeze(value, 100), 3);
}

}  // namespace
}  // namespace rsfm

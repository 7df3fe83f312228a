#include "rsfm/io/pgm.h"

#include <gtest/gtest.h>

#include <string>

namespace rsfm {
namespace {

using namespace std::string_literals;

TEST(PgmTest, PixelsAreFoundBehindAnyGoodHeader) {
  for (const char* header :
       {"P5\n3 2\n255\n", "P5 3 2 255 ", "P5\t3\r\n2\n255\t",
        "P5\n# a camera\n3 2 # more\n# and more\n255\n", "P5#\n3#\n#\n2 255\n"}) {
    EXPECT_EQ(PgmPixels(header + "abcdef"s, 3, 2), "abcdef") << header;
    EXPECT_EQ(PgmPixels(header + "abcdefgh"s, 3, 2), "abcdef") << header;  // more may follow
    EXPECT_TRUE(PgmPixels(header + "abcde"s, 3, 2).empty()) << header;
    EXPECT_TRUE(PgmPixels(header + "abcdef"s, 2, 3).empty()) << header;
  }
  // Pixels may look like blanks and comments.
  EXPECT_EQ(PgmPixels("P5\n3 2\n255\n\n#  \n\n"s, 3, 2), "\n#  \n\n");
}

TEST(PgmTest, AnythingElseIsNone) {
  for (const std::string& text :
       {""s, "P"s, "P5"s, "P5\n"s, "P2\n3 2\n255\nabcdef"s, "P53 2\n255\nabcdef"s,
        "P5\n3 2\n65535\nabcdefabcdef"s, "P5\n3 2\n254\nabcdef"s, "P5\n32\n255\nabcdef"s,
        "P5\n3 2\n255"s, "P5\n3 2\n255abcdef"s, "P5\n-3 2\n255\nabcdef"s, "P5\n3 2 #255\nabcdef"s,
        "P5\n3 2\n2550000\nabcdef"s, "P5\n0000003 2\n255\nabcdef"s, "P5\n3 2\n255\n"s, "P5 #"s}) {
    EXPECT_TRUE(PgmPixels(text, 3, 2).empty()) << text;
  }
  EXPECT_TRUE(PgmPixels("P5\n0 0\n255\n"s, 0, 0).empty());
}

}  // namespace
}  // namespace rsfm

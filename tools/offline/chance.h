// Whether a two-view geometry is more than a coincidence of matches that are wrong, or that lie on
// things which move each in its own way.
#pragma once

#include <span>

#include "rsfm/base/linear.h"

namespace rsfm {

struct MatchedPixels {
  Vec2 a = Vec2::Zero(), b = Vec2::Zero();
};

// The decimal logarithm of the expected number of essential matrices, of all that five matches
// give, which as many matches would obey as closely by chance. Above 0 it happens by chance.
//   [Moisan & Stival 2004, IJCV 57(3), eq. (12)] with 10 solutions of the five points
// Matches that start and end side by side (in cells of an eighth of the image's width) say the
// same thing and count once, as an inlier where most of them are. `inlier` goes with `matches`.
double LogFalseAlarms(std::span<const MatchedPixels> matches, std::span<const char> inlier,
                      double max_error_px, int width, int height);

}  // namespace rsfm

// The bend of a survey: the error that refraction makes when it is modelled wrongly, and the one
// that images alone hold least.
#pragma once

#include <span>
#include <vector>

#include "rsfm/base/error.h"
#include "rsfm/base/linear.h"

namespace rsfm {

struct Bend {
  double sagitta_m = 0.0;     // height of the middle over the rim, along `up`
  double radius_m = 0.0;      // of 95 % of the places about their middle, across `up`
  bool along_line = false;    // the places lie along a line: the bend is that of the line
  std::vector<Vec3> weights;  // d sagitta / d place
};

// The paraboloid of revolution that fits the places' heights best, in least squares,
//   h = a + b x + c y - k r^2 / 2,   sagitta = k radius^2 / 2,
// or the parabola along them where they are longer than six times their width. `up` is the side
// that counts as above, of any length: against the cameras' view.
//   kNotEnoughData  fewer than 6 places
//   kDegenerate     `up` is zero, or the places lie within a hundredth of their height
Expected<Bend> FitBend(std::span<const Vec3> places, const Vec3& up);

// Those that are no farther from the middle of all, along `up` and across it, than ten times the
// median distance: one point that was triangulated from a wrong match lies above a whole survey.
std::vector<Vec3> WithoutFarOff(std::span<const Vec3> places, const Vec3& up);

}  // namespace rsfm

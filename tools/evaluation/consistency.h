// Whether a mission's poses are as good as they said they were, and what state they were in: by the
// covariances that the mapper published, against the truth.
#pragma once

#include <array>
#include <optional>
#include <vector>

#include "rsfm/io/mission.h"
#include "tools/evaluation/ground_truth.h"

namespace rsfm {

struct Consistency {
  // As long as frames follow each other in one state.
  struct Spell {
    int state = 0;             // pose_t.STATE_*
    Utime begin = 0, end = 0;  // of its first frame and of the next spell's (the last: of its last)
    int num_frames = 0;
    int num_jumps = 0;                  // announced by reset_counter
    int num_judged = 0;                 // poses with a covariance and a truth
    double position_error_max_m = 0.0;  // of those, since the first
    double nees = 0.0;                  // mean
  };
  std::vector<Spell> spells;
  int num_judged = 0;
  double nees = 0.0;       // mean of error' covariance^-1 error; 6 where the covariance is right
  // The same of parts: north and east (2 where right), down (1), about the level axes (2), about the
  // vertical (1).
  std::array<double, 4> nees_of_parts{};
  double within_95 = 0.0;  // share of the poses in their covariance's 95 % ellipsoid
};

// Errors are of (position, rotation) along and about the world's axes, as the covariances are;
// where the world lies, north and east, is that of the first pose. Frames of one time count once,
// as said last. None where the world is not NED, or no pose has both a covariance and a truth.
std::optional<Consistency> EvaluateConsistency(const Mission& mission, const GroundTruth& truth);

}  // namespace rsfm

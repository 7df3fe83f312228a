// A made-up survey: a camera in lawnmower lines over a rough seabed, with what it sees of it.
#pragma once

#include <cmath>
#include <vector>

#include "rsfm/base/rigid3.h"
#include "rsfm/base/rng.h"
#include "rsfm/refraction/any_camera.h"

namespace rsfm {

struct SurveyOptions {
  int lines = 2;
  int images_per_line = 5;
  int num_points = 400;
  double altitude_m = 3.0;  // mean
  double forward_m = 0.6;   // between images
  double sideways_m = 1.0;  // between lines
  double relief_m = 0.4;    // the seabed is uniform in +-relief
  double tilt_rad = 0.1;    // the attitude is uniform in +-tilt about each axis
  double noise_px = 0.5;
  std::uint64_t seed = 1;
};

struct SurveyObservation {
  int image = 0;
  int point = 0;
  Vec2 pixel = Vec2::Zero();
};

struct Survey {
  std::vector<Rigid3> camera_from_world;  // world: x forward, y right, z down; seabed at z = 0
  std::vector<Vec3> points;               // each seen by two images or more
  std::vector<SurveyObservation> observations;
};

inline Survey MakeSurvey(const AnyCamera& camera, const SurveyOptions& options) {
  Rng rng(options.seed);
  Survey survey;
  for (int line = 0; line < options.lines; ++line) {
    for (int i = 0; i < options.images_per_line; ++i) {
      const double along = line % 2 == 0 ? i : options.images_per_line - 1 - i;
      const Vec3 place(along * options.forward_m + rng.Uniform(-0.05, 0.05),
                       line * options.sideways_m + rng.Uniform(-0.05, 0.05),
                       -options.altitude_m * rng.Uniform(0.9, 1.1));
      const double t = options.tilt_rad;
      Vec3 turn(rng.Uniform(-t, t), rng.Uniform(-t, t), rng.Uniform(-t, t));
      if (line % 2 == 1) turn.z() += 3.0;
      survey.camera_from_world.push_back(Rigid3(ExpSo3(turn), place).Inverse());
    }
  }
  std::vector<Vec3> places;
  for (const Rigid3& pose : survey.camera_from_world) places.push_back(pose.OriginOfTarget());
  const double width = options.images_per_line * options.forward_m + options.altitude_m;
  const double height = options.lines * options.sideways_m + options.altitude_m;
  for (int p = 0; p < options.num_points; ++p) {
    const Vec3 point(rng.Uniform(0.0, width) - 0.5 * options.altitude_m,
                     rng.Uniform(0.0, height) - 0.5 * options.altitude_m,
                     rng.Uniform(-options.relief_m, options.relief_m));
    std::vector<SurveyObservation> seen;
    for (std::size_t k = 0; k < survey.camera_from_world.size(); ++k) {
      // Far outside of any image: not worth tracing.
      if ((places[k] - point).head<2>().norm() > 4.0 * options.altitude_m) continue;
      Vec2 pixel;
      if (camera.Project(survey.camera_from_world[k] * point, &pixel) != Projection::kOk ||
          !camera.IsInImage(pixel))
        continue;
      pixel += options.noise_px * Vec2(rng.Gaussian(), rng.Gaussian());
      seen.push_back({static_cast<int>(k), static_cast<int>(survey.points.size()), pixel});
    }
    if (seen.size() < 2) continue;
    survey.points.push_back(point);
    survey.observations.insert(survey.observations.end(), seen.begin(), seen.end());
  }
  return survey;
}

// Poses and points moved off the truth, the first `keep` poses excepted.
inline void Disturb(Survey* survey, int keep, double rotation_rad, double translation_m,
                    double point_m, std::uint64_t seed) {
  Rng rng(seed);
  const auto vector = [&rng](double size) {
    return Vec3(rng.Uniform(-size, size), rng.Uniform(-size, size), rng.Uniform(-size, size));
  };
  for (std::size_t k = 0; k < survey->camera_from_world.size(); ++k) {
    Vec6 delta;
    delta << vector(rotation_rad), vector(translation_m);
    if (static_cast<int>(k) >= keep)
      survey->camera_from_world[k] = Perturb(survey->camera_from_world[k], delta);
  }
  for (Vec3& point : survey->points) point += vector(point_m);
}

}  // namespace rsfm

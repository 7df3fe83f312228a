#include "tools/evaluation/solver_methods.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "rsfm/estimation/five_point.h"
#include "rsfm/estimation/generalised_eight_point.h"
#include "rsfm/estimation/ransac.h"
#include "rsfm/estimation/ray_pair.h"
#include "rsfm/estimation/seventeen_point.h"
#include "tools/evaluation/distorted_best_fit.h"

namespace rsfm {
namespace {

RansacOptions PaperRansac(double max_error_px, std::uint64_t seed) {
  RansacOptions options;
  options.max_error_px = max_error_px;
  options.confidence = 0.99999;
  options.min_iterations = 100;
  options.max_iterations = 10000;
  options.max_evaluations = 100'000'000;
  options.max_refinements = 0;
  options.seed = seed;
  return options;
}

std::vector<RayPair> MakePairs(const AnyCamera& camera, const std::vector<Vec2>& pixels_a,
                               const std::vector<Vec2>& pixels_b) {
  std::vector<RayPair> pairs;
  pairs.reserve(pixels_a.size());
  for (std::size_t i = 0; i < pixels_a.size(); ++i) {
    RayPair pair;
    if (!BackprojectDifferentiated(camera, pixels_a[i], &pair.a) ||
        !BackprojectDifferentiated(camera, pixels_b[i], &pair.b)) {
      continue;  // an outlier far outside the image
    }
    pair.index = static_cast<int>(i);
    pairs.push_back(pair);
  }
  return pairs;
}

// What the three problems share: the first-order image distance of the generalised epipolar
// constraint as the error; no local optimisation where they do not say otherwise.
template <int kSize, int kMaxModels>
class RelativeProblem {
 public:
  static constexpr int kSampleSize = kSize;
  static constexpr int kErrorDof = 1;
  using Model = RelativePose;
  using Models = StaticVector<RelativePose, kMaxModels>;

  explicit RelativeProblem(std::span<const RayPair> pairs) : pairs_(pairs) {}
  int Size() const { return static_cast<int>(pairs_.size()); }
  double SquaredError(const Model& model, int i) const {
    return SquaredSampsonError(model, pairs_[static_cast<std::size_t>(i)]);
  }
  bool Refine(std::span<const int>, Model*) const { return false; }

 protected:
  void Rays(std::span<const int, kSize> sample, std::array<Ray3, kSize>* a,
            std::array<Ray3, kSize>* b) const {
    for (int i = 0; i < kSize; ++i) {
      (*a)[i] = pairs_[sample[i]].a.ray;
      (*b)[i] = pairs_[sample[i]].b.ray;
    }
  }
  std::span<const RayPair> pairs_;
};

class FivePointProblem : public RelativeProblem<kFivePointSampleSize, 20> {
 public:
  using RelativeProblem::RelativeProblem;
  void Solve(std::span<const int, kSampleSize> sample, Models* models) const {
    std::array<Vec3, kSampleSize> a, b;
    for (int i = 0; i < kSampleSize; ++i) {
      a[i] = pairs_[sample[i]].a.ray.direction;
      b[i] = pairs_[sample[i]].b.ray.direction;
    }
    for (const Mat3& essential : SolveFivePoint(a, b)) {
      for (const Rigid3& pose : DecomposeEssential(essential)) {
        bool is_in_front = true;
        for (int i = 0; i < kSampleSize && is_in_front; ++i)
          is_in_front = IsInFront(pose, a[i], b[i]);
        if (is_in_front) models->TryPushBack(RelativePose::FromRigid(pose));
      }
    }
  }
};

// The peer's RANSAC for perspective cameras optimises locally, so this does.
class LocallyOptimisedFivePoint : public FivePointProblem {
 public:
  using FivePointProblem::FivePointProblem;
  bool Refine(std::span<const int> inliers, Model* model) const {
    EpipolarRefineOptions options;
    options.weighting = EpipolarWeighting::kSampson;
    options.max_iterations = 10;
    return RefineEpipolar(pairs_, inliers, options, model) > 0;
  }
};

class SeventeenPointProblem : public RelativeProblem<kSeventeenPointSampleSize, 2> {
 public:
  using RelativeProblem::RelativeProblem;
  void Solve(std::span<const int, kSampleSize> sample, Models* models) const {
    std::array<Ray3, kSampleSize> a, b;
    Rays(sample, &a, &b);
    for (const Rigid3& pose : SolveSeventeenPoint(a, b))
      models->TryPushBack(RelativePose::FromRigid(pose));
  }
};

// From five starts, so that none of the method's failures is one of its start alone: no turn, and
// 0.8 rad to each side, up and down.
class EightPointProblem : public RelativeProblem<kGeneralisedEightPointSampleSize, 5> {
 public:
  using RelativeProblem::RelativeProblem;
  void Solve(std::span<const int, kSampleSize> sample, Models* models) const {
    std::array<Ray3, kSampleSize> a, b;
    Rays(sample, &a, &b);
    for (const Vec3& turn : {Vec3(0.0, 0.0, 0.0), Vec3(0.0, 0.8, 0.0), Vec3(0.0, -0.8, 0.0),
                             Vec3(0.8, 0.0, 0.0), Vec3(-0.8, 0.0, 0.0)}) {
      Rigid3 pose;
      if (SolveGeneralisedEightPoint(a, b, ExpSo3(turn).toRotationMatrix(), &pose))
        models->TryPushBack(RelativePose::FromRigid(pose));
    }
  }
};

template <class Problem>
std::optional<SolverResult> RunRansac(const std::vector<RayPair>& pairs, std::size_t size,
                                      const RansacOptions& options, RansacWorkspace* workspace,
                                      RelativePose* pose) {
  Problem problem(pairs);
  const auto report = Ransac(problem, options, workspace, pose);
  if (!report) return std::nullopt;
  return SolverResult{pose->ToRigid(),
                      static_cast<double>(report->num_inliers) / static_cast<double>(size)};
}

// Five points on a perspective camera.
std::optional<SolverResult> SolveCentral(const AnyCamera& camera, const std::vector<Vec2>& pixels_a,
                                         const std::vector<Vec2>& pixels_b, std::uint64_t seed,
                                         RansacWorkspace* workspace) {
  const std::vector<RayPair> pairs = MakePairs(camera, pixels_a, pixels_b);
  RelativePose pose;
  RansacOptions options = PaperRansac(4.0, seed);
  options.max_refinements = RansacOptions().max_refinements;
  return RunRansac<LocallyOptimisedFivePoint>(pairs, pixels_a.size(), options, workspace, &pose);
}

std::optional<SolverResult> SolveBestFit(const AnyCamera& camera, const RelativePoseScene& scene,
                                         std::uint64_t seed, bool refine,
                                         RansacWorkspace* workspace) {
  const auto central = FitWithDistortion(camera);
  if (!central) return std::nullopt;
  std::optional<SolverResult> result =
      SolveCentral(*central, scene.pixels_a, scene.pixels_b, seed, workspace);
  if (!result || !refine) return result;

  // The length is free: a start of one metre, no prior to speak of.
  const std::vector<RayPair> pairs = MakePairs(camera, scene.pixels_a, scene.pixels_b);
  const std::vector<RayPair> central_pairs = MakePairs(*central, scene.pixels_a, scene.pixels_b);
  std::vector<std::uint8_t> fits(scene.pixels_a.size(), 0);
  for (const int i : workspace->inliers) fits[central_pairs[i].index] = 1;
  std::vector<int> active;
  for (int i = 0; i < static_cast<int>(pairs.size()); ++i) {
    if (fits[pairs[i].index]) active.push_back(i);
  }
  EpipolarRefineOptions options;
  options.weighting = EpipolarWeighting::kAlgebraic;
  options.max_iterations = 100;
  options.min_baseline_m = 0.01;
  options.priors.weak_log_sigma = 1e6;
  RelativePose pose = RelativePose::FromRigid(result->pose);
  RefineEpipolar(pairs, active, options, &pose);
  int inliers = 0;
  for (const RayPair& pair : pairs) inliers += SquaredSampsonError(pose, pair) < 16.0;
  return SolverResult{pose.ToRigid(),
                      static_cast<double>(inliers) / static_cast<double>(scene.pixels_a.size())};
}

std::optional<SolverResult> SolveOurs(const AnyCamera& camera, const RelativePoseScene& scene,
                                      std::uint64_t seed, SolverWorkspace* workspace) {
  TwoViewOptions options;
  options.ransac.max_error_px = 4.0;
  options.ransac.confidence = 0.99999;
  options.ransac.seed = seed;
  const auto report =
      workspace->relative.Estimate(camera, camera, scene.pixels_a, scene.pixels_b, options);
  if (!report) return std::nullopt;
  return SolverResult{report->b_from_a, static_cast<double>(report->num_inliers) /
                                            static_cast<double>(scene.pixels_a.size())};
}

}  // namespace

std::string_view ToString(AbsoluteMethod method) {
  switch (method) {
    case AbsoluteMethod::kP3pInAir:
      return "p3p_in_air";
    case AbsoluteMethod::kGp3p:
      return "gp3p";
    case AbsoluteMethod::kGp3pRefined:
      break;
  }
  return "gp3p_refined";
}

std::string_view ToString(RelativeMethod method) {
  switch (method) {
    case RelativeMethod::kFivePointInAir:
      return "five_point_in_air";
    case RelativeMethod::kBestFit:
      return "best_fit";
    case RelativeMethod::kBestFitRefined:
      return "best_fit_refined";
    case RelativeMethod::kHu17:
      return "hu17";
    case RelativeMethod::kGr6p:
      return "gr6p";
    case RelativeMethod::kOurs:
      break;
  }
  return "ours";
}

std::optional<SolverResult> SolveAbsolute(AbsoluteMethod method, const AnyCamera& camera,
                                          const AbsolutePoseScene& scene, std::uint64_t seed,
                                          SolverWorkspace* workspace) {
  AbsolutePoseOptions options;
  options.ransac = PaperRansac(12.0, seed);
  if (method == AbsoluteMethod::kGp3pRefined) {
    options.ransac.max_refinements = RansacOptions().max_refinements;
    options.ransac.min_iterations = RansacOptions().min_iterations;
  } else {
    options.max_refine_iterations = 0;
  }
  const bool in_air = method == AbsoluteMethod::kP3pInAir;
  const auto report = workspace->absolute.Estimate(in_air ? SolverCameraInAir() : camera,
                                                   in_air ? scene.pixels_in_air : scene.pixels,
                                                   scene.points_in_world, options);
  if (!report) return std::nullopt;
  return SolverResult{report->camera_from_world, static_cast<double>(report->num_inliers) /
                                                     static_cast<double>(scene.pixels.size())};
}

std::optional<SolverResult> SolveRelative(RelativeMethod method, const AnyCamera& camera,
                                          const RelativePoseScene& scene, std::uint64_t seed,
                                          SolverWorkspace* workspace) {
  RansacOptions options = PaperRansac(4.0, seed);
  RelativePose pose;
  switch (method) {
    case RelativeMethod::kFivePointInAir:
      return SolveCentral(SolverCameraInAir(), scene.in_air_a, scene.in_air_b, seed,
                          &workspace->ransac);
    case RelativeMethod::kBestFit:
      return SolveBestFit(camera, scene, seed, false, &workspace->ransac);
    case RelativeMethod::kBestFitRefined:
      return SolveBestFit(camera, scene, seed, true, &workspace->ransac);
    case RelativeMethod::kHu17: {
      options.max_iterations = 2000;
      const std::vector<RayPair> pairs = MakePairs(camera, scene.pixels_a, scene.pixels_b);
      return RunRansac<SeventeenPointProblem>(pairs, scene.pixels_a.size(), options,
                                              &workspace->ransac, &pose);
    }
    case RelativeMethod::kGr6p: {
      options.max_iterations = 200;
      const std::vector<RayPair> pairs = MakePairs(camera, scene.pixels_a, scene.pixels_b);
      return RunRansac<EightPointProblem>(pairs, scene.pixels_a.size(), options, &workspace->ransac,
                                          &pose);
    }
    case RelativeMethod::kOurs:
      break;
  }
  return SolveOurs(camera, scene, seed, workspace);
}

}  // namespace rsfm

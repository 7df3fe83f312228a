// Minimal solvers, absolute pose, two views and triangulation, one thread. The rows with a counter
// `ratio` are measured beside the paper's way (paper_estimation.h) in the same run: how many times
// faster. `rot_deg`, `pos_mm`, `dir_deg` are the mean errors of both over the scenes, at 1 px of
// noise, 200 points, 30 % outliers.
#include <benchmark/benchmark.h>

#include <chrono>
#include <vector>

#include "rsfm/estimation/absolute_pose.h"
#include "rsfm/estimation/five_point.h"
#include "rsfm/estimation/generalised_eight_point.h"
#include "rsfm/estimation/generalised_pnp.h"
#include "rsfm/estimation/gp3p.h"
#include "rsfm/estimation/p3p.h"
#include "rsfm/estimation/seventeen_point.h"
#include "rsfm/estimation/triangulation.h"
#include "rsfm/estimation/two_view.h"
#include "rsfm/estimation/upright_absolute_pose.h"
#include "rsfm/estimation/upright_relative_pose.h"
#include "tests/benchmarks/paper_estimation.h"
#include "tests/estimation/scenes.h"

namespace rsfm {
namespace {

constexpr int kProblems = 1024;
constexpr int kScenes = 20;

struct AbsoluteSample {
  std::array<Ray3, 3> rays;
  std::array<Vec3, 3> bearings, points;
};

std::vector<AbsoluteSample> AbsoluteSamples(RigKind kind) {
  Rng rng(1);
  std::vector<AbsoluteSample> samples(kProblems);
  for (AbsoluteSample& sample : samples) {
    const AnyCamera camera = RandomRig(kind, &rng);
    const AbsoluteScene scene = MakeAbsoluteScene(camera, 0.0, 0.0, 3, &rng);
    for (int i = 0; i < 3; ++i) {
      if (camera.Backproject(scene.pixels[i], &sample.rays[i]) != Projection::kOk) std::abort();
      sample.bearings[i] = sample.rays[i].direction;
      sample.points[i] = scene.points_in_world[i];
    }
  }
  return samples;
}

void P3p(benchmark::State& state) {
  const std::vector<AbsoluteSample> samples = AbsoluteSamples(RigKind::kNone);
  std::size_t i = 0;
  for (auto _ : state) {
    const AbsoluteSample& sample = samples[i++ % kProblems];
    benchmark::DoNotOptimize(SolveP3p(sample.bearings, sample.points));
  }
}
BENCHMARK(P3p);

void Gp3p(benchmark::State& state, RigKind kind) {
  const std::vector<AbsoluteSample> samples = AbsoluteSamples(kind);
  std::size_t i = 0;
  for (auto _ : state) {
    const AbsoluteSample& sample = samples[i++ % kProblems];
    benchmark::DoNotOptimize(SolveGp3p(sample.rays, sample.points));
  }
}
BENCHMARK_CAPTURE(Gp3p, flat, RigKind::kFlat);
BENCHMARK_CAPTURE(Gp3p, dome, RigKind::kDome);
BENCHMARK_CAPTURE(Gp3p, centred_dome, RigKind::kCentredDome);

void FivePoint(benchmark::State& state) {
  Rng rng(2);
  const AnyCamera camera = RandomRig(RigKind::kNone, &rng);
  std::vector<std::array<Vec3, 5>> a(kProblems), b(kProblems);
  for (int k = 0; k < kProblems; ++k) {
    const RelativeScene scene = MakeRelativeScene(
        camera, PaperSecondCamera(&rng), [](Rng* r, const Ray3&) { return r->Uniform(6.0, 8.0); },
        0.0, 0.0, 5, &rng);
    for (int i = 0; i < 5; ++i) {
      Ray3 ray;
      (void)camera.Backproject(scene.pixels_a[i], &ray);
      a[k][i] = ray.direction;
      (void)camera.Backproject(scene.pixels_b[i], &ray);
      b[k][i] = ray.direction;
    }
  }
  std::size_t i = 0;
  for (auto _ : state) {
    benchmark::DoNotOptimize(SolveFivePoint(a[i % kProblems], b[i % kProblems]));
    ++i;
  }
}
BENCHMARK(FivePoint);

void UprightAbsolute(benchmark::State& state) {
  const std::vector<AbsoluteSample> samples = AbsoluteSamples(RigKind::kFlat);
  const Vec3 down = Vec3(0.1, -0.2, 1.0).normalized();
  std::size_t i = 0;
  for (auto _ : state) {
    const AbsoluteSample& sample = samples[i++ % kProblems];
    benchmark::DoNotOptimize(SolveUprightAbsolutePose(
        std::array<Ray3, 2>{sample.rays[0], sample.rays[1]},
        std::array<Vec3, 2>{sample.points[0], sample.points[1]}, down, down));
  }
}
BENCHMARK(UprightAbsolute);

void GeneralisedPnp(benchmark::State& state) {
  Rng rng(6);
  const AnyCamera camera = RandomRig(RigKind::kFlat, &rng);
  const AbsoluteScene scene =
      MakeAbsoluteScene(camera, 1.0, 0.0, static_cast<int>(state.range(0)), &rng);
  std::vector<Ray3> rays(scene.pixels.size());
  for (std::size_t i = 0; i < rays.size(); ++i) (void)camera.Backproject(scene.pixels[i], &rays[i]);
  for (auto _ : state) benchmark::DoNotOptimize(SolveGeneralisedPnp(rays, scene.points_in_world));
}
BENCHMARK(GeneralisedPnp)->Arg(6)->Arg(100)->Unit(benchmark::kMicrosecond);

// The solvers on the rays of two views behind flat ports.
struct RelativeSample {
  std::array<Ray3, 17> a, b;
  Rigid3 b_from_a;
};
std::vector<RelativeSample> RelativeSamples() {
  Rng rng(7);
  std::vector<RelativeSample> samples(128);
  for (RelativeSample& sample : samples) {
    const AnyCamera camera = RandomRig(RigKind::kFlat, &rng);
    const RelativeScene scene = MakeRelativeScene(
        camera, PaperSecondCamera(&rng), [](Rng* r, const Ray3&) { return r->Uniform(6.0, 8.0); },
        0.5, 0.0, 17, &rng);
    sample.b_from_a = scene.b_from_a;
    for (int i = 0; i < 17; ++i) {
      (void)camera.Backproject(scene.pixels_a[i], &sample.a[i]);
      (void)camera.Backproject(scene.pixels_b[i], &sample.b[i]);
    }
  }
  return samples;
}

void SeventeenPoint(benchmark::State& state) {
  const std::vector<RelativeSample> samples = RelativeSamples();
  std::size_t i = 0;
  for (auto _ : state) {
    const RelativeSample& sample = samples[i++ % samples.size()];
    benchmark::DoNotOptimize(SolveSeventeenPoint(sample.a, sample.b));
  }
}
BENCHMARK(SeventeenPoint)->Unit(benchmark::kMicrosecond);

void GeneralisedEightPoint(benchmark::State& state) {
  const std::vector<RelativeSample> samples = RelativeSamples();
  std::size_t i = 0;
  for (auto _ : state) {
    const RelativeSample& sample = samples[i++ % samples.size()];
    Rigid3 pose;
    benchmark::DoNotOptimize(SolveGeneralisedEightPoint(
        std::span<const Ray3, 17>(sample.a).first<8>(),
        std::span<const Ray3, 17>(sample.b).first<8>(), Mat3::Identity(), &pose));
  }
}
BENCHMARK(GeneralisedEightPoint)->Unit(benchmark::kMicrosecond);

void UprightRelative(benchmark::State& state) {
  const std::vector<RelativeSample> samples = RelativeSamples();
  const Vec3 down = Vec3::UnitY();
  std::size_t i = 0;
  for (auto _ : state) {
    const RelativeSample& s = samples[i++ % samples.size()];
    benchmark::DoNotOptimize(SolveUprightRelativePose(
        std::array<Vec3, 3>{s.a[0].direction, s.a[1].direction, s.a[2].direction},
        std::array<Vec3, 3>{s.b[0].direction, s.b[1].direction, s.b[2].direction}, down,
        s.b_from_a.rotation * down));
  }
}
BENCHMARK(UprightRelative);

double Seconds(std::chrono::steady_clock::time_point since) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - since).count();
}

void AbsolutePose(benchmark::State& state, RigKind kind, bool refine) {
  Rng rng(3);
  std::vector<AnyCamera> cameras;
  std::vector<AbsoluteScene> scenes;
  for (int k = 0; k < kScenes; ++k) {
    cameras.push_back(RandomRig(kind, &rng));
    scenes.push_back(MakeAbsoluteScene(cameras.back(), 1.0, 0.3, 200, &rng));
  }
  AbsolutePoseOptions options;
  options.ransac.max_error_px = 12.0;
  options.ransac.confidence = 0.99999;
  if (!refine) options.max_refine_iterations = 0;
  AbsolutePoseEstimator estimator(200);
  double own = 0.0, baseline = 0.0, rotation = 0.0, position = 0.0, baseline_rotation = 0.0,
         runs = 0.0;
  int k = 0;
  for (auto _ : state) {
    const AnyCamera& camera = cameras[k % kScenes];
    const AbsoluteScene& scene = scenes[k % kScenes];
    options.ransac.seed = ++k;
    const auto start = std::chrono::steady_clock::now();
    const auto report = estimator.Estimate(camera, scene.pixels, scene.points_in_world, options);
    const double seconds = Seconds(start);
    state.SetIterationTime(seconds);
    own += seconds;
    if (!report) {
      state.SkipWithError("no pose");
      break;
    }
    const auto start_baseline = std::chrono::steady_clock::now();
    const Rigid3 plain =
        paper::AbsolutePose(camera, scene.pixels, scene.points_in_world, 12.0, options.ransac.seed);
    baseline += Seconds(start_baseline);
    rotation +=
        Degrees(AngleBetween(report->camera_from_world.rotation, scene.camera_from_world.rotation));
    position += 1e3 * (report->camera_from_world.OriginOfTarget() -
                       scene.camera_from_world.OriginOfTarget())
                          .norm();
    baseline_rotation += Degrees(AngleBetween(plain.rotation, scene.camera_from_world.rotation));
    runs += 1.0;
  }
  state.counters["ratio"] = baseline / own;
  state.counters["rot_deg"] = rotation / runs;
  state.counters["pos_mm"] = position / runs;
  state.counters["baseline_rot_deg"] = baseline_rotation / runs;
}
void AbsolutePoseRansac(benchmark::State& state, RigKind kind) { AbsolutePose(state, kind, false); }
void AbsolutePoseRansacAndRefinement(benchmark::State& state, RigKind kind) {
  AbsolutePose(state, kind, true);
}
BENCHMARK_CAPTURE(AbsolutePoseRansac, flat, RigKind::kFlat)
    ->UseManualTime()
    ->Unit(benchmark::kMicrosecond);
BENCHMARK_CAPTURE(AbsolutePoseRansac, dome, RigKind::kDome)
    ->UseManualTime()
    ->Unit(benchmark::kMicrosecond);
BENCHMARK_CAPTURE(AbsolutePoseRansacAndRefinement, flat, RigKind::kFlat)
    ->UseManualTime()
    ->Unit(benchmark::kMicrosecond);
BENCHMARK_CAPTURE(AbsolutePoseRansacAndRefinement, dome, RigKind::kDome)
    ->UseManualTime()
    ->Unit(benchmark::kMicrosecond);

void TwoView(benchmark::State& state, RigKind kind) {
  Rng rng(4);
  std::vector<AnyCamera> cameras;
  std::vector<RelativeScene> scenes;
  for (int k = 0; k < kScenes; ++k) {
    cameras.push_back(RandomRig(kind, &rng));
    scenes.push_back(MakePaperRelativeScene(cameras.back(), 1.0, &rng));
  }
  TwoViewOptions options;
  options.ransac.confidence = 0.99999;
  TwoViewEstimator estimator(200);
  double own = 0.0, baseline = 0.0, rotation = 0.0, direction = 0.0, runs = 0.0;
  double baseline_rotation = 0.0, baseline_direction = 0.0;
  int k = 0;
  for (auto _ : state) {
    const AnyCamera& camera = cameras[k % kScenes];
    const RelativeScene& scene = scenes[k % kScenes];
    options.ransac.seed = ++k;
    const auto start = std::chrono::steady_clock::now();
    const auto report = estimator.Estimate(camera, camera, scene.pixels_a, scene.pixels_b, options);
    const double seconds = Seconds(start);
    state.SetIterationTime(seconds);
    own += seconds;
    if (!report) {
      state.SkipWithError("no pose");
      break;
    }
    const auto start_baseline = std::chrono::steady_clock::now();
    const Rigid3 plain =
        paper::RelativePose(camera, scene.pixels_a, scene.pixels_b, 4.0, options.ransac.seed);
    baseline += Seconds(start_baseline);
    rotation += Degrees(AngleBetween(report->b_from_a.rotation, scene.b_from_a.rotation));
    direction += Degrees(DirectionError(report->b_from_a, scene.b_from_a));
    baseline_rotation += Degrees(AngleBetween(plain.rotation, scene.b_from_a.rotation));
    baseline_direction += Degrees(DirectionError(plain, scene.b_from_a));
    runs += 1.0;
  }
  state.counters["ratio"] = baseline / own;
  state.counters["rot_deg"] = rotation / runs;
  state.counters["dir_deg"] = direction / runs;
  state.counters["baseline_rot_deg"] = baseline_rotation / runs;
  state.counters["baseline_dir_deg"] = baseline_direction / runs;
}
BENCHMARK_CAPTURE(TwoView, flat, RigKind::kFlat)->UseManualTime()->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(TwoView, dome, RigKind::kDome)->UseManualTime()->Unit(benchmark::kMillisecond);

void TriangulateFourViews(benchmark::State& state, RigKind kind) {
  Rng rng(5);
  const AnyCamera camera = RandomRig(kind, &rng);
  std::vector<TriangulationView> views;
  for (int i = 0; i < 4; ++i) {
    TriangulationView view;
    view.camera = &camera;
    view.camera_from_world = Rigid3(Quat::Identity(), Vec3(0.3 * i - 0.45, 0.1 * i, 0.0));
    if (camera.Project(view.camera_from_world * Vec3(0.1, 0.0, 3.0), &view.pixel) !=
        Projection::kOk)
      std::abort();
    view.pixel += GaussianPixel(&rng, 0.5);
    views.push_back(view);
  }
  for (auto _ : state) benchmark::DoNotOptimize(Triangulate(views));
}
BENCHMARK_CAPTURE(TriangulateFourViews, flat, RigKind::kFlat);
BENCHMARK_CAPTURE(TriangulateFourViews, dome, RigKind::kDome);

}  // namespace
}  // namespace rsfm

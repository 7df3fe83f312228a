// Projection and back-projection, one thread: rsfm against the paper's way (paper_projection.h) in
// the same run. The counter `ratio` of each row is its speed over the baseline's, measured next to
// it; `M/s` is millions a second.
#include <benchmark/benchmark.h>

#include <chrono>
#include <string>
#include <vector>

#include "rsfm/refraction/any_camera.h"
#include "rsfm/refraction/best_fit.h"
#include "rsfm/refraction/virtual_camera.h"
#include "tests/benchmarks/paper_projection.h"
#include "tests/support/rigs.h"

namespace rsfm {
namespace {

constexpr int kPoints = 4096;

struct Fixture {
  CameraConfig config;
  AnyCamera camera;
  paper::Camera baseline;
  std::vector<Vec2> pixels, out_pixels;
  std::vector<Vec3> points;
  std::vector<Ray3> rays;
  std::vector<Projection> statuses;
};

Fixture MakeFixture(bool flat, bool opencv) {
  Rng rng(1);
  CameraConfig config = PaperLens();
  if (opencv) {
    config.lens = LensModel::kOpenCV;
    config.lens_params = {1297.37, 1297.37, 960.0, 540.0, -0.1, 0.02, 1e-4, -2e-4};
  }
  config.port = flat ? RandomFlatPort(&rng) : RandomDomePort(&rng);
  Fixture fixture{config, *AnyCamera::Create(config), {config}, {}, {}, {}, {}, {}};
  fixture.rays.resize(kPoints);
  fixture.out_pixels.resize(kPoints);
  fixture.statuses.resize(kPoints);
  for (int i = 0; i < kPoints; ++i) {
    fixture.pixels.emplace_back(rng.Uniform(0, 1920), rng.Uniform(0, 1080));
    Ray3 ray;
    if (fixture.camera.Backproject(fixture.pixels.back(), &ray) != Projection::kOk) std::abort();
    fixture.points.push_back(ray.At(rng.Uniform(0.5, 10.0)));
  }
  return fixture;
}

template <class F>
double SecondsFor(int rounds, F&& f) {
  double best = 1e9;
  for (int i = 0; i < rounds; ++i) {
    const auto start = std::chrono::steady_clock::now();
    f();
    best = std::min(
        best, std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
  }
  return best;
}

// Runs `ours` (kPoints operations a call) under the benchmark, the baseline beside it, and reports
// their ratio.
template <class Ours, class Baseline>
void Compare(benchmark::State& state, Ours&& ours, Baseline&& baseline) {
  const double baseline_seconds = SecondsFor(7, baseline);
  double best = 1e9;
  for (auto _ : state) {
    best = std::min(best, SecondsFor(1, ours));
  }
  state.counters["M/s"] = kPoints / best * 1e-6;
  state.counters["baseline_M/s"] = kPoints / baseline_seconds * 1e-6;
  state.counters["ratio"] = baseline_seconds / best;
}

void Project(benchmark::State& state, bool flat, bool opencv) {
  Fixture f = MakeFixture(flat, opencv);
  Compare(
      state,
      [&] {
        for (int i = 0; i < kPoints; ++i)
          benchmark::DoNotOptimize(f.camera.Project(f.points[i], &f.out_pixels[i]));
      },
      [&] {
        for (int i = 0; i < kPoints; ++i)
          benchmark::DoNotOptimize(f.out_pixels[i] = f.baseline.Project(f.points[i]));
      });
}

void ProjectBatch(benchmark::State& state, bool flat, bool opencv) {
  Fixture f = MakeFixture(flat, opencv);
  Compare(
      state, [&] { f.camera.Project(f.points, f.out_pixels, f.statuses); },
      [&] {
        for (int i = 0; i < kPoints; ++i)
          benchmark::DoNotOptimize(f.out_pixels[i] = f.baseline.Project(f.points[i]));
      });
}

// Here the baseline is our own plain projection: what the derivatives cost on top (ratio 0.5 is
// twice the time).
void ProjectWithJacobians(benchmark::State& state, bool flat, bool opencv) {
  Fixture f = MakeFixture(flat, opencv);
  CameraJacobian jacobian;
  Compare(
      state,
      [&] {
        for (int i = 0; i < kPoints; ++i) {
          benchmark::DoNotOptimize(f.camera.Project(f.points[i], &f.out_pixels[i], &jacobian));
          benchmark::DoNotOptimize(jacobian);
        }
      },
      [&] {
        for (int i = 0; i < kPoints; ++i)
          benchmark::DoNotOptimize(f.camera.Project(f.points[i], &f.out_pixels[i]));
      });
}

void Backproject(benchmark::State& state, bool flat, bool opencv) {
  Fixture f = MakeFixture(flat, opencv);
  Compare(
      state,
      [&] {
        for (int i = 0; i < kPoints; ++i)
          benchmark::DoNotOptimize(f.camera.Backproject(f.pixels[i], &f.rays[i]));
      },
      [&] {
        for (int i = 0; i < kPoints; ++i)
          benchmark::DoNotOptimize(f.rays[i] = f.baseline.Backproject(f.pixels[i]));
      });
}

void BestFit(benchmark::State& state, bool flat) {
  Fixture f = MakeFixture(flat, true);
  for (auto _ : state) benchmark::DoNotOptimize(FitPerspective(f.camera));
}

void Virtual(benchmark::State& state, bool flat) {
  Fixture f = MakeFixture(flat, false);
  VirtualCamera virtual_camera;
  for (auto _ : state) {
    for (int i = 0; i < 400; ++i)
      benchmark::DoNotOptimize(ComputeVirtualCamera(f.camera, f.pixels[i], &virtual_camera));
  }
}

int RegisterAll() {
  using benchmark::kMicrosecond;
  for (const bool flat : {true, false}) {
    const std::string port = flat ? "flat" : "dome";
    for (const bool opencv : {false, true}) {
      const std::string name = port + (opencv ? "/OPENCV" : "/PINHOLE");
      benchmark::RegisterBenchmark(("project/" + name).c_str(), Project, flat, opencv)
          ->Unit(kMicrosecond);
      benchmark::RegisterBenchmark(("project_batch/" + name).c_str(), ProjectBatch, flat, opencv)
          ->Unit(kMicrosecond);
      benchmark::RegisterBenchmark(("project_with_jacobians/" + name).c_str(), ProjectWithJacobians,
                                   flat, opencv)
          ->Unit(kMicrosecond);
      benchmark::RegisterBenchmark(("backproject/" + name).c_str(), Backproject, flat, opencv)
          ->Unit(kMicrosecond);
    }
    benchmark::RegisterBenchmark(("best_fit_perspective/" + port).c_str(), BestFit, flat)
        ->Unit(kMicrosecond);
    benchmark::RegisterBenchmark(("virtual_cameras_2x200/" + port).c_str(), Virtual, flat)
        ->Unit(kMicrosecond);
  }
  return 0;
}
const int registered = RegisterAll();

}  // namespace
}  // namespace rsfm

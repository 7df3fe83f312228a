// Projection and back-projection, one thread: rsfm against the paper's way (paper_projection.h) in
// the same run. The counter `ratio` of each row is its speed over the baseline's, measured next to
// it; `M/s` is millions a second. Both are of the fastest of many rounds, in the thread's own time.
// At the end the whole is printed once more as a table, beside the floors and the aims that the
// project has set itself.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <cstdio>
#include <ctime>
#include <string>
#include <vector>

#include "rsfm/refraction/any_camera.h"
#include "rsfm/refraction/best_fit.h"
#include "rsfm/refraction/ray_table.h"
#include "rsfm/refraction/virtual_camera.h"
#include "tests/benchmarks/paper_projection.h"
#include "tests/support/rigs.h"

namespace rsfm {
namespace {

constexpr int kPoints = 1024;

enum class PortKind { kFlat, kDome, kLayered };

// Floors and aims, zero for none: the ratio to the baseline, and millions a second.
struct Goal {
  double floor_ratio = 0.0, aim_ratio = 0.0, floor_speed = 0.0, aim_speed = 0.0;
};
struct Case {
  std::string name;
  PortKind kind;
  bool is_opencv;
  Goal goal;
};
struct Row {
  std::string name;
  double speed, ratio;
  Goal goal;
};
std::vector<Row>& Rows() {
  static std::vector<Row> rows;
  return rows;
}

struct Fixture {
  CameraConfig config;
  AnyCamera camera;
  paper::Camera baseline;
  std::vector<Vec2> pixels, out_pixels;
  std::vector<Vec3> points;
  std::vector<Ray3> rays;
  std::vector<Projection> statuses;
};

Fixture MakeFixture(PortKind kind, bool opencv) {
  Rng rng(1);
  CameraConfig config = PaperLens();
  if (opencv) {
    config.lens = LensModel::kOpenCV;
    config.lens_params = {1297.37, 1297.37, 960.0, 540.0, -0.1, 0.02, 1e-4, -2e-4};
  }
  config.port = kind == PortKind::kFlat   ? RandomFlatPort(&rng)
                : kind == PortKind::kDome ? RandomDomePort(&rng)
                                          : RandomLayeredPort(&rng);
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

// This thread's own seconds: what else runs on the machine does not count.
double Now() {
  timespec time{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

template <class F>
double SecondsFor(int rounds, F&& f) {
  double best = 1e9;
  for (int i = 0; i < rounds; ++i) {
    const double start = Now();
    f();
    best = std::min(best, Now() - start);
  }
  return best;
}

// Runs `ours` under the benchmark, the baseline beside it (`points` operations a call each), and
// reports their ratio.
template <class Ours, class Baseline>
void Compare(benchmark::State& state, const Case& c, Ours&& ours, Baseline&& baseline,
             double points = kPoints) {
  double baseline_seconds = SecondsFor(15, baseline), best = 1e9;
  for (auto _ : state) best = std::min(best, SecondsFor(1, ours));
  baseline_seconds = std::min(baseline_seconds, SecondsFor(15, baseline));
  const double speed = points / best * 1e-6, ratio = baseline_seconds / best;
  state.counters["M/s"] = speed;
  state.counters["baseline_M/s"] = points / baseline_seconds * 1e-6;
  state.counters["ratio"] = ratio;
  // The benchmark runs a case more than once to settle its number of iterations: the last counts.
  std::erase_if(Rows(), [&](const Row& row) { return row.name == c.name; });
  Rows().push_back({c.name, speed, ratio, c.goal});
}

void Project(benchmark::State& state, const Case& c) {
  Fixture f = MakeFixture(c.kind, c.is_opencv);
  Compare(
      state, c,
      [&] {
        for (int i = 0; i < kPoints; ++i)
          benchmark::DoNotOptimize(f.camera.Project(f.points[i], &f.out_pixels[i]));
      },
      [&] {
        for (int i = 0; i < kPoints; ++i)
          benchmark::DoNotOptimize(f.out_pixels[i] = f.baseline.Project(f.points[i]));
      });
}

void ProjectBatch(benchmark::State& state, const Case& c) {
  Fixture f = MakeFixture(c.kind, c.is_opencv);
  Compare(
      state, c, [&] { f.camera.Project(f.points, f.out_pixels, f.statuses); },
      [&] {
        for (int i = 0; i < kPoints; ++i)
          benchmark::DoNotOptimize(f.out_pixels[i] = f.baseline.Project(f.points[i]));
      });
}

// Here the baseline is our own plain projection: what the derivatives cost on top (ratio 0.5 is
// twice the time).
void ProjectWithJacobians(benchmark::State& state, const Case& c) {
  Fixture f = MakeFixture(c.kind, c.is_opencv);
  CameraJacobian jacobian;
  Compare(
      state, c,
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

void Backproject(benchmark::State& state, const Case& c) {
  Fixture f = MakeFixture(c.kind, c.is_opencv);
  Compare(
      state, c,
      [&] {
        for (int i = 0; i < kPoints; ++i)
          benchmark::DoNotOptimize(f.camera.Backproject(f.pixels[i], &f.rays[i]));
      },
      [&] {
        for (int i = 0; i < kPoints; ++i)
          benchmark::DoNotOptimize(f.rays[i] = f.baseline.Backproject(f.pixels[i]));
      });
}

void BackprojectBatch(benchmark::State& state, const Case& c) {
  Fixture f = MakeFixture(c.kind, c.is_opencv);
  Compare(
      state, c, [&] { f.camera.Backproject(f.pixels, f.rays, f.statuses); },
      [&] {
        for (int i = 0; i < kPoints; ++i)
          benchmark::DoNotOptimize(f.rays[i] = f.baseline.Backproject(f.pixels[i]));
      });
}

// The baseline is our own plain back-projection, as for the projection's Jacobians.
void BackprojectWithJacobians(benchmark::State& state, const Case& c) {
  Fixture f = MakeFixture(c.kind, c.is_opencv);
  RayJacobian jacobian;
  Compare(
      state, c,
      [&] {
        for (int i = 0; i < kPoints; ++i) {
          benchmark::DoNotOptimize(f.camera.Backproject(f.pixels[i], &f.rays[i], &jacobian));
          benchmark::DoNotOptimize(jacobian);
        }
      },
      [&] {
        for (int i = 0; i < kPoints; ++i)
          benchmark::DoNotOptimize(f.camera.Backproject(f.pixels[i], &f.rays[i]));
      });
}

// A ray for each pixel, row by row; the baseline back-projects them one by one.
void TableRows(benchmark::State& state, const Case& c) {
  Fixture f = MakeFixture(c.kind, c.is_opencv);
  const auto table = RayTable::Create(f.camera);
  int row = 0;
  std::vector<Ray3> rays(kPoints);
  std::vector<Projection> statuses(kPoints);
  Compare(
      state, c,
      [&] {
        for (int i = 0; i < 16; ++i) table->LookupRow(row = (row + 1) % 1080, 450, rays, statuses);
        benchmark::DoNotOptimize(rays.data());
      },
      [&] {
        for (int k = 0; k < 16 * kPoints; ++k)
          benchmark::DoNotOptimize(f.rays[k % kPoints] =
                                       f.baseline.Backproject(f.pixels[k % kPoints]));
      },
      16.0 * kPoints);
  state.counters["max_error_px"] = table->max_error_px();
  state.counters["KiB"] = static_cast<double>(table->Bytes() >> 10);
}

void TableAnyPixel(benchmark::State& state, const Case& c) {
  Fixture f = MakeFixture(c.kind, c.is_opencv);
  const auto table = RayTable::Create(f.camera);
  Compare(
      state, c, [&] { table->Lookup(f.pixels, f.rays, f.statuses); },
      [&] {
        for (int i = 0; i < kPoints; ++i)
          benchmark::DoNotOptimize(f.rays[i] = f.baseline.Backproject(f.pixels[i]));
      });
}

void BestFit(benchmark::State& state, PortKind kind) {
  Fixture f = MakeFixture(kind, true);
  double best = 1e9;
  for (auto _ : state)
    best =
        std::min(best, SecondsFor(1, [&] { benchmark::DoNotOptimize(FitPerspective(f.camera)); }));
  state.counters["fastest_ms"] = 1e3 * best;
}

void Virtual(benchmark::State& state, PortKind kind) {
  Fixture f = MakeFixture(kind, false);
  VirtualCamera virtual_camera;
  double best = 1e9;
  for (auto _ : state) {
    best = std::min(
        best, SecondsFor(1, [&] {
          for (int i = 0; i < 400; ++i)
            benchmark::DoNotOptimize(ComputeVirtualCamera(f.camera, f.pixels[i], &virtual_camera));
        }));
  }
  state.counters["fastest_ms"] = 1e3 * best;
}

using Operation = void (*)(benchmark::State&, const Case&);
void Register(const std::string& operation, Operation f, PortKind kind, const Goal& pinhole,
              const Goal& opencv) {
  const std::string port = kind == PortKind::kFlat   ? "/flat"
                           : kind == PortKind::kDome ? "/dome"
                                                     : "/layered";
  for (const bool is_opencv : {false, true}) {
    const Case c{operation + port + (is_opencv ? "/OPENCV" : "/PINHOLE"), kind, is_opencv,
                 is_opencv ? opencv : pinhole};
    benchmark::RegisterBenchmark(c.name.c_str(), [f, c](benchmark::State& state) {
      f(state, c);
    })->Unit(benchmark::kMicrosecond);
  }
}

int RegisterAll() {
  for (const PortKind kind : {PortKind::kFlat, PortKind::kDome, PortKind::kLayered}) {
    const bool flat = kind == PortKind::kFlat, layered = kind == PortKind::kLayered;
    const Goal none;
    const Goal project = flat ? Goal{10, 20, 6, 12} : Goal{8, 15, 3.5, 7};
    const Goal project_opencv = flat ? Goal{25, 50, 6, 12} : Goal{15, 30, 3.5, 7};
    if (layered) {  // the baseline knows one layer only: its ratio means nothing here
      Register("project_of_own", ProjectWithJacobians, kind, none, none);
      Register("backproject_of_own", BackprojectWithJacobians, kind, none, none);
      continue;
    }
    Register("project", Project, kind, project, project_opencv);
    const Goal batch = flat ? Goal{0, 0, 12, 25} : none;
    Register("project_batch", ProjectBatch, kind, batch, batch);
    const Goal jacobians{1.0 / 3.0, 0.5, 0, 0};
    Register("project_with_jacobians", ProjectWithJacobians, kind, jacobians, jacobians);
    Register("backproject", Backproject, kind, {1.2, 2, 0, 0}, {2.5, 4, 0, 0});
    Register("backproject_batch", BackprojectBatch, kind, none, none);
    Register("backproject_with_jacobians", BackprojectWithJacobians, kind, none, none);
    Register("ray_table_rows", TableRows, kind, {0, 0, 100, 0}, {0, 0, 100, 0});
    Register("ray_table_any_pixel", TableAnyPixel, kind, none, none);
    const std::string port = flat ? "flat" : "dome";
    benchmark::RegisterBenchmark(("best_fit_perspective/" + port).c_str(), BestFit, kind)
        ->Unit(benchmark::kMillisecond);
    benchmark::RegisterBenchmark(("virtual_cameras_2x200/" + port).c_str(), Virtual, kind)
        ->Unit(benchmark::kMillisecond);
  }
  return 0;
}

std::string Text(double value, const char* suffix) {
  char text[32];
  std::snprintf(text, sizeof text, "%.3g%s", value, suffix);
  return value > 0.0 ? text : "";
}

void PrintTable() {
  std::printf("\n%-40s %10s %10s   %-18s %-18s %s\n", "operation", "M/s", "ratio", "floor", "aim",
              "met");
  for (const Row& row : Rows()) {
    const Goal& g = row.goal;
    const bool has_goal = g.floor_ratio > 0.0 || g.floor_speed > 0.0;
    const bool floor = row.ratio >= g.floor_ratio && row.speed >= g.floor_speed;
    const bool aim = row.ratio >= g.aim_ratio && row.speed >= g.aim_speed;
    std::printf("%-40s %10.3g %10.3g   %-18s %-18s %s\n", row.name.c_str(), row.speed, row.ratio,
                (Text(g.floor_ratio, " x ") + Text(g.floor_speed, " M/s")).c_str(),
                (Text(g.aim_ratio, " x ") + Text(g.aim_speed, " M/s")).c_str(),
                !has_goal ? ""
                : !floor  ? "no"
                : aim     ? "aim"
                          : "floor");
  }
  std::printf("(with_jacobians and of_own: the baseline is our own plain call)\n");
}

}  // namespace
}  // namespace rsfm

int main(int argc, char** argv) {
  rsfm::RegisterAll();
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 1;
  benchmark::RunSpecifiedBenchmarks();
  rsfm::PrintTable();
  return 0;
}

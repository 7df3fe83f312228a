// Bundle adjustment against the paper's way (paper_bundle.h) and against Ceres, in one run. The
// counter `ratio` of each row is the baseline's time over ours, measured next to it.
//   Residual/*     image error with all derivatives, against the virtual-image error in Jets
//   WindowBa/*     the on-board window adjustment against Ceres with the same residual, one thread
//   GlobalBa/*     one iteration of the desk's adjustment against the same problem in Jets
#include <benchmark/benchmark.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <memory>
#include <vector>

#include "rsfm/estimation/reprojection_residual.h"
#include "rsfm/estimation/window_ba.h"
#include "tests/benchmarks/paper_bundle.h"
#include "tests/support/rigs.h"
#include "tests/support/survey.h"
#include "tools/offline/bundle.h"
#include "tools/offline/ceres_costs.h"

namespace rsfm {
namespace {

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

CameraConfig MakeConfig(PortType port, bool opencv) {
  CameraConfig config = PaperLens();
  if (opencv) {
    config.lens = LensModel::kOpenCV;
    config.lens_params = {1297.37, 1297.37, 960.0, 540.0, -0.1, 0.02, 1e-4, -2e-4};
  }
  Rng rng(1);
  config.port = port == PortType::kFlat ? RandomFlatPort(&rng) : RandomDomePort(&rng);
  return config;
}

// The blocks that the paper's residual works on.
struct Blocks {
  std::vector<std::array<double, 4>> rotations;
  std::vector<Vec3> translations, points;
  std::vector<double> lens;
  PortParams port;
};
Blocks ToBlocks(const CameraConfig& config, const Survey& survey) {
  Blocks blocks;
  for (const Rigid3& pose : survey.camera_from_world) {
    const Quat& q = pose.rotation;
    blocks.rotations.push_back({q.x(), q.y(), q.z(), q.w()});
    blocks.translations.push_back(pose.translation);
  }
  blocks.points = survey.points;
  blocks.lens.assign(config.lens_params.begin(), config.lens_params.end());
  blocks.port = config.port.Params();
  return blocks;
}

template <int kLens, PortType kPort>
void Residual(benchmark::State& state) {
  const CameraConfig config = MakeConfig(kPort, kLens == 8);
  const AnyCamera camera = *AnyCamera::Create(config);
  const Survey survey = MakeSurvey(camera, {});
  Blocks blocks = ToBlocks(config, survey);
  std::vector<std::unique_ptr<ceres::CostFunction>> costs;
  for (const SurveyObservation& o : survey.observations)
    costs.emplace_back(paper::VirtualError<kLens, kPort>::Create(o.pixel));
  double residual[2], d[5][2 * 8];
  double* jacobians[] = {d[0], d[1], d[2], d[3], d[4]};
  const double baseline = SecondsFor(10, [&] {
    for (std::size_t i = 0; i < costs.size(); ++i) {
      const SurveyObservation& o = survey.observations[i];
      const double* parameters[] = {
          blocks.rotations[o.image].data(), blocks.translations[o.image].data(),
          blocks.points[o.point].data(), blocks.lens.data(), blocks.port.data()};
      costs[i]->Evaluate(parameters, residual, jacobians);
      benchmark::DoNotOptimize(residual);
    }
  });
  const auto ours_once = [&](auto* jacobian) {
    for (const SurveyObservation& o : survey.observations) {
      Vec2 error;
      if (ReprojectionError(camera, survey.camera_from_world[o.image], survey.points[o.point],
                            o.pixel, &error, jacobian) != Projection::kOk)
        std::abort();
      benchmark::DoNotOptimize(error);
    }
  };
  ReprojectionJacobian all;
  double ours = SecondsFor(10, [&] { ours_once(&all); });
  const double poses_and_points = SecondsFor(10, [&] {
    for (const SurveyObservation& o : survey.observations) {
      Vec2 error;
      Mat26 d_pose;
      Mat23 d_point;
      if (ReprojectionError(camera, survey.camera_from_world[o.image], survey.points[o.point],
                            o.pixel, &error, &d_pose, &d_point) != Projection::kOk)
        std::abort();
      benchmark::DoNotOptimize(error);
    }
  });
  for (auto _ : state) ours_once(&all);
  const double count = static_cast<double>(costs.size());
  state.counters["ratio"] = baseline / ours;
  state.counters["ratio_calibrated"] = baseline / poses_and_points;
  state.counters["ns"] = 1e9 * ours / count;
  state.counters["ns_calibrated"] = 1e9 * poses_and_points / count;
  state.counters["ns_baseline"] = 1e9 * baseline / count;
}

void FillWindow(const Survey& survey, WindowBa* ba) {
  ba->Clear();
  bool ok = true;
  for (std::size_t k = 0; k < survey.camera_from_world.size(); ++k)
    ok = ok && ba->AddKeyframe(survey.camera_from_world[k], 0, k < 2);
  for (const Vec3& point : survey.points) ok = ok && ba->AddLandmark(point);
  for (const SurveyObservation& o : survey.observations)
    ok = ok && ba->AddObservation(o.image, o.point, o.pixel);
  if (!ok) std::abort();
}

BundleProblem ToProblem(const CameraConfig& config, const Survey& survey, int num_fixed) {
  BundleProblem problem;
  problem.cameras = {config};
  for (std::size_t k = 0; k < survey.camera_from_world.size(); ++k)
    problem.images.push_back({survey.camera_from_world[k], 0, static_cast<int>(k) < num_fixed});
  problem.points = survey.points;
  for (const SurveyObservation& o : survey.observations)
    problem.observations.push_back({o.image, o.point, o.pixel});
  return problem;
}

// Both stop by the same tolerance; ours includes the filling, of Ceres only the solver is counted.
void WindowAgainstCeres(benchmark::State& state) {
  const CameraConfig config =
      MakeConfig(state.range(0) == 0 ? PortType::kFlat : PortType::kDome, false);
  const std::vector<AnyCamera> cameras = {*AnyCamera::Create(config)};
  SurveyOptions options;
  options.num_points = 1500;
  Survey survey = MakeSurvey(cameras[0], options);
  Disturb(&survey, 2, 0.004, 0.02, 0.03, 8);
  BundleOptions ceres_options;
  ceres_options.loss = {LossType::kHuber, 1.0};
  ceres_options.num_threads = 1;
  ceres_options.function_tolerance = 1e-6;
  double baseline = 1e9;
  int baseline_iterations = 0;
  for (int i = 0; i < 5; ++i) {
    BundleProblem problem = ToProblem(config, survey, 2);
    const auto report = AdjustBundle(ceres_options, &problem);
    if (!report) std::abort();
    baseline = std::min(baseline, report->seconds);
    baseline_iterations = report->iterations;
  }
  WindowBa ba = *WindowBa::Create({});
  WindowBaReport report;
  const auto ours_once = [&] {
    FillWindow(survey, &ba);
    report = *ba.Solve(cameras, {});
  };
  const double ours = SecondsFor(5, ours_once);
  for (auto _ : state) ours_once();
  state.counters["ratio"] = baseline / ours;
  state.counters["ratio_per_iteration"] =
      (baseline / baseline_iterations) / (ours / report.iterations);
  state.counters["ms"] = 1e3 * ours;
  state.counters["ms_ceres"] = 1e3 * baseline;
  state.counters["iterations"] = report.iterations;
  state.counters["iterations_ceres"] = baseline_iterations;
  state.counters["observations"] = static_cast<double>(survey.observations.size());
}

// Seconds an iteration of Ceres on the paper's residual, with the solver that the desk chooses.
template <PortType kPort>
double PaperSecondsPerIteration(const CameraConfig& config, const Survey& survey, int threads) {
  Blocks blocks = ToBlocks(config, survey);
  ceres::Problem problem;
  ceres::EigenQuaternionManifold* quaternion = new ceres::EigenQuaternionManifold;
  auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  for (const SurveyObservation& o : survey.observations)
    problem.AddResidualBlock(paper::VirtualError<4, kPort>::Create(o.pixel),
                             new ceres::CauchyLoss(1.0), blocks.rotations[o.image].data(),
                             blocks.translations[o.image].data(), blocks.points[o.point].data(),
                             blocks.lens.data(), blocks.port.data());
  for (Vec3& point : blocks.points) ordering->AddElementToGroup(point.data(), 0);
  for (std::size_t k = 0; k < blocks.rotations.size(); ++k) {
    problem.SetManifold(blocks.rotations[k].data(), quaternion);
    ordering->AddElementToGroup(blocks.rotations[k].data(), 1);
    ordering->AddElementToGroup(blocks.translations[k].data(), 1);
  }
  problem.SetParameterBlockConstant(blocks.rotations[0].data());
  problem.SetParameterBlockConstant(blocks.translations[0].data());
  problem.SetParameterBlockConstant(blocks.lens.data());
  problem.SetParameterBlockConstant(blocks.port.data());
  ordering->AddElementToGroup(blocks.lens.data(), 1);
  ordering->AddElementToGroup(blocks.port.data(), 1);
  ceres::Solver::Options solver;
  solver.linear_solver_type = ceres::SPARSE_SCHUR;
  solver.linear_solver_ordering = ordering;
  solver.num_threads = threads;
  solver.max_num_iterations = 5;
  solver.function_tolerance = 0.0;
  ceres::Solver::Summary summary;
  ceres::Solve(solver, &problem, &summary);
  return summary.minimizer_time_in_seconds /
         std::max<double>(1.0, static_cast<double>(summary.iterations.size()) - 1.0);
}

template <PortType kPort>
void GlobalIteration(benchmark::State& state) {
  const CameraConfig config = MakeConfig(kPort, false);
  const AnyCamera camera = *AnyCamera::Create(config);
  SurveyOptions options;
  options.lines = 10;
  options.images_per_line = 10;
  options.num_points = 5000;
  Survey survey = MakeSurvey(camera, options);
  Disturb(&survey, 1, 0.005, 0.02, 0.02, 3);
  constexpr int kThreads = 2;
  const double baseline = PaperSecondsPerIteration<kPort>(config, survey, kThreads);
  BundleOptions bundle_options;
  bundle_options.num_threads = kThreads;
  bundle_options.max_iterations = 5;
  bundle_options.function_tolerance = 0.0;
  double ours = 1e9;
  for (auto _ : state) {
    BundleProblem problem = ToProblem(config, survey, 1);
    const auto report = AdjustBundle(bundle_options, &problem);
    if (!report) std::abort();
    ours = std::min(ours, report->seconds / report->iterations);
  }
  state.counters["ratio"] = baseline / ours;
  state.counters["ms"] = 1e3 * ours;
  state.counters["ms_baseline"] = 1e3 * baseline;
  state.counters["observations"] = static_cast<double>(survey.observations.size());
}

BENCHMARK(Residual<4, PortType::kFlat>)->Name("Residual/PINHOLE/flat");
BENCHMARK(Residual<4, PortType::kDome>)->Name("Residual/PINHOLE/dome");
BENCHMARK(Residual<8, PortType::kFlat>)->Name("Residual/OPENCV/flat");
BENCHMARK(Residual<8, PortType::kDome>)->Name("Residual/OPENCV/dome");
BENCHMARK(WindowAgainstCeres)
    ->Name("WindowBa/10_keyframes")
    ->Arg(0)
    ->Arg(1)
    ->Unit(benchmark::kMillisecond);
BENCHMARK(GlobalIteration<PortType::kFlat>)
    ->Name("GlobalBa/100_images/flat")
    ->Unit(benchmark::kMillisecond)
    ->Iterations(3);
BENCHMARK(GlobalIteration<PortType::kDome>)
    ->Name("GlobalBa/100_images/dome")
    ->Unit(benchmark::kMillisecond)
    ->Iterations(3);

}  // namespace
}  // namespace rsfm

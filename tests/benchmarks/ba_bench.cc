// Bundle adjustment against the paper's way (paper_bundle.h) and against Ceres, in one run. The
// counter `ratio` of each row is the baseline's time over ours, measured next to it.
//   Residual/*     image error with all derivatives, against the virtual-image error in Jets
//   WindowBa/*     the on-board window adjustment against Ceres with the same residual, one thread
//   GlobalBa/*     the desk's adjustment to convergence against the paper's cost with SPARSE_SCHUR,
//                  each in a process of its own, memory and pose error beside it
#include <benchmark/benchmark.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <memory>
#include <vector>

#include "rsfm/estimation/reprojection_residual.h"
#include "rsfm/estimation/window_ba.h"
#include "tests/benchmarks/paper_bundle.h"
#include "tests/offline/alignment.h"
#include "tests/support/ceres_bundle.h"
#include "tests/support/rigs.h"
#include "tests/support/survey.h"
#include "tools/offline/bundle.h"

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
    const auto report = AdjustBundleByCeres(ceres_options, &problem);
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

// What one solver did with one survey, measured in a process of its own.
struct Outcome {
  double seconds = 0.0, cpu_seconds = 0.0, peak_mib = 0.0;  // above what the survey itself takes
  double rms_mm = 0.0, scale = 0.0;                         // of the places, against the truth
  int iterations = 0, observations = 0;
  bool converged = false;
};

// A limit for a look at single iterations; without it everything runs to convergence.
int MaxIterations() {
  const char* limit = std::getenv("RSFM_BA_BENCH_ITERATIONS");
  return limit != nullptr ? std::atoi(limit) : 100;
}
constexpr double kTolerance = 1e-6;
constexpr int kThreads = 2;

void Judge(const std::vector<Vec3>& places, const Survey& truth, Outcome* outcome) {
  std::vector<Vec3> true_places;
  for (const Rigid3& pose : truth.camera_from_world) true_places.push_back(pose.OriginOfTarget());
  const Alignment alignment = AlignPlaces(places, true_places);
  outcome->rms_mm = 1e3 * alignment.rms_m;
  outcome->scale = alignment.scale;
}

// Ceres on the paper's residual with SPARSE_SCHUR, lens and port held, the first pose fixed. No
// robust loss: the same one would mean another thing for virtual pixels than for true ones.
template <PortType kPort>
void SolveAsThePaper(const CameraConfig& config, const Survey& survey, const Survey& truth,
                     Outcome* outcome) {
  Blocks blocks = ToBlocks(config, survey);
  ceres::Problem problem;
  auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  for (const SurveyObservation& o : survey.observations)
    problem.AddResidualBlock(paper::VirtualError<4, kPort>::Create(o.pixel), nullptr,
                             blocks.rotations[o.image].data(), blocks.translations[o.image].data(),
                             blocks.points[o.point].data(), blocks.lens.data(), blocks.port.data());
  for (Vec3& point : blocks.points) ordering->AddElementToGroup(point.data(), 0);
  for (std::size_t k = 0; k < blocks.rotations.size(); ++k) {
    problem.SetManifold(blocks.rotations[k].data(), new ceres::EigenQuaternionManifold);
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
  solver.num_threads = kThreads;
  solver.max_num_iterations = MaxIterations();
  solver.function_tolerance = kTolerance;
  ceres::Solver::Summary summary;
  ceres::Solve(solver, &problem, &summary);
  outcome->iterations = static_cast<int>(summary.iterations.size()) - 1;
  outcome->converged = summary.termination_type == ceres::CONVERGENCE;
  std::vector<Vec3> places;
  for (std::size_t k = 0; k < blocks.rotations.size(); ++k) {
    const auto& q = blocks.rotations[k];
    places.push_back(Rigid3(Quat(q[3], q[0], q[1], q[2]), blocks.translations[k]).OriginOfTarget());
  }
  Judge(places, truth, outcome);
}

void SolveAsWeDo(const CameraConfig& config, const Survey& survey, const Survey& truth,
                 Outcome* outcome) {
  BundleProblem problem = ToProblem(config, survey, 1);
  BundleOptions options;
  options.num_threads = kThreads;
  options.max_iterations = MaxIterations();
  options.function_tolerance = kTolerance;
  options.loss = {};
  const auto report = AdjustBundle(options, &problem);
  if (!report) std::abort();
  outcome->iterations = report->iterations;
  outcome->converged = report->converged;
  std::vector<Vec3> places;
  for (const BundleImage& image : problem.images)
    places.push_back(image.camera_from_world.OriginOfTarget());
  Judge(places, truth, outcome);
}

double Seconds(const timeval& time) {
  return static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_usec);
}
double CpuSeconds() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return Seconds(usage.ru_utime) + Seconds(usage.ru_stime);
}
double PeakMib() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) / 1024.0;
}

template <class Solve>
Outcome InOwnProcess(const Survey& truth, Solve&& solve) {
  int ends[2];
  if (pipe(ends) != 0) std::abort();
  const pid_t child = fork();
  if (child < 0) std::abort();
  if (child == 0) {
    Survey survey = truth;
    Disturb(&survey, 1, 0.005, 0.02, 0.02, 3);
    Outcome outcome;
    outcome.observations = static_cast<int>(survey.observations.size());
    const double peak = PeakMib(), cpu = CpuSeconds();
    const auto start = std::chrono::steady_clock::now();
    solve(survey, &outcome);
    outcome.seconds =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    outcome.cpu_seconds = CpuSeconds() - cpu;
    outcome.peak_mib = PeakMib() - peak;
    const bool written = write(ends[1], &outcome, sizeof(outcome)) == sizeof(outcome);
    _exit(written ? 0 : 1);
  }
  close(ends[1]);
  Outcome outcome;
  if (read(ends[0], &outcome, sizeof(outcome)) != sizeof(outcome)) std::abort();
  close(ends[0]);
  int status = 0;
  waitpid(child, &status, 0);
  return outcome;
}

// To convergence from the same start, the same relative tolerance of the cost, the same threads.
template <PortType kPort>
void GlobalBundle(benchmark::State& state) {
  const CameraConfig config = MakeConfig(kPort, false);
  SurveyOptions options;
  options.lines = static_cast<int>(state.range(0));
  options.images_per_line = static_cast<int>(state.range(1));
  options.num_points = static_cast<int>(state.range(2));
  options.forward_m = 0.5;
  options.sideways_m = 0.8;
  const Survey truth = MakeSurvey(*AnyCamera::Create(config), options);
  Outcome ours, paper;
  for (auto _ : state) {
    ours = InOwnProcess(truth, [&](const Survey& survey, Outcome* outcome) {
      SolveAsWeDo(config, survey, truth, outcome);
    });
    paper = InOwnProcess(truth, [&](const Survey& survey, Outcome* outcome) {
      SolveAsThePaper<kPort>(config, survey, truth, outcome);
    });
  }
  state.counters["ratio"] = paper.seconds / ours.seconds;
  state.counters["ratio_cpu"] = paper.cpu_seconds / ours.cpu_seconds;
  state.counters["ratio_cpu_per_iteration"] =
      (paper.cpu_seconds / paper.iterations) / (ours.cpu_seconds / ours.iterations);
  state.counters["ratio_memory"] = paper.peak_mib / ours.peak_mib;
  state.counters["s"] = ours.seconds;
  state.counters["s_paper"] = paper.seconds;
  state.counters["cpu_s"] = ours.cpu_seconds;
  state.counters["cpu_s_paper"] = paper.cpu_seconds;
  state.counters["mib"] = ours.peak_mib;
  state.counters["mib_paper"] = paper.peak_mib;
  state.counters["iterations"] = ours.iterations;
  state.counters["iterations_paper"] = paper.iterations;
  state.counters["converged"] = ours.converged;
  state.counters["converged_paper"] = paper.converged;
  state.counters["rms_mm"] = ours.rms_mm;
  state.counters["rms_mm_paper"] = paper.rms_mm;
  state.counters["observations"] = ours.observations;
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
// lines, images a line, points offered
BENCHMARK(GlobalBundle<PortType::kFlat>)
    ->Name("GlobalBa/flat")
    ->Args({10, 10, 5000})
    ->Args({25, 40, 100000})
    ->Unit(benchmark::kSecond)
    ->Iterations(1);
BENCHMARK(GlobalBundle<PortType::kDome>)
    ->Name("GlobalBa/dome")
    ->Args({10, 10, 5000})
    ->Args({25, 40, 100000})
    ->Unit(benchmark::kSecond)
    ->Iterations(1);

}  // namespace
}  // namespace rsfm

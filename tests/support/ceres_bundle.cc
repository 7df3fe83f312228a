#include "tests/support/ceres_bundle.h"

#include <algorithm>
#include <cmath>
#include <memory>

#include "tests/support/ceres_costs.h"

namespace rsfm {
namespace {

class ProgressCallback : public ceres::IterationCallback {
 public:
  explicit ProgressCallback(const BundleOptions& options) : options_(options) {}
  ceres::CallbackReturnType operator()(const ceres::IterationSummary& summary) override {
    if (!options_.progress) return ceres::SOLVER_CONTINUE;
    const BundleProgress progress{summary.iteration, options_.max_iterations, summary.cost};
    return options_.progress(progress) ? ceres::SOLVER_CONTINUE
                                       : ceres::SOLVER_TERMINATE_SUCCESSFULLY;
  }

 private:
  const BundleOptions& options_;
};

// The Ceres problem and the memory behind its blocks.
class Adjustment {
 public:
  Adjustment(const BundleOptions& options, const BundleProblem& problem) : options_(options) {
    for (const CameraConfig& config : problem.cameras)
      cameras_.push_back(std::make_unique<CameraState>(config));
    for (const BundleImage& image : problem.images)
      poses_.push_back(ToBlock(image.camera_from_world));
    points_ = problem.points;
    ceres::Problem::Options problem_options;
    problem_options.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    problem_options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    problem_options.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    problem_options.disable_all_safety_checks = true;
    ceres_ = std::make_unique<ceres::Problem>(problem_options);
    loss_.reset(MakeLoss(options.loss));
  }

  void AddObservations(const BundleProblem& problem) {
    costs_.reserve(problem.observations.size());
    for (const BundleObservation& o : problem.observations) {
      const int index = problem.images[o.image].camera;
      CameraState* camera = cameras_[index].get();
      const bool refine =
          options_.lens.Any() || RefinesPort(camera->config.port.type, options_.port);
      costs_.push_back(
          std::make_unique<ReprojectionCost>(camera, o.pixel, options_.sigma_px, refine));
      std::vector<double*> blocks = {poses_[o.image].data(), points_[o.point].data()};
      if (refine) blocks.insert(blocks.end(), {camera->lens.data(), camera->port.data()});
      ceres_->AddResidualBlock(costs_.back().get(), loss_.get(), blocks);
    }
  }

  void AddPriors(const std::vector<PosePrior>& priors) {
    for (const PosePrior& prior : priors) {
      costs_.push_back(std::make_unique<PriorCost>(prior));
      losses_.emplace_back(MakeLoss(prior.loss));
      std::vector<double*> blocks = {poses_[prior.a].data()};
      if (prior.IsRelative()) blocks.push_back(poses_[prior.b].data());
      ceres_->AddResidualBlock(costs_.back().get(), losses_.back().get(), blocks);
    }
  }

  void SetPoseManifolds(const BundleProblem& problem) {
    for (std::size_t i = 0; i < poses_.size(); ++i) {
      if (!ceres_->HasParameterBlock(poses_[i].data())) continue;
      ceres_->SetManifold(poses_[i].data(), &pose_manifold_);
      if (problem.images[i].fixed) ceres_->SetParameterBlockConstant(poses_[i].data());
    }
  }

  void SetCameraManifolds(const BundleProblem& problem) {
    for (std::size_t i = 0; i < cameras_.size(); ++i) {
      CameraState& camera = *cameras_[i];
      const CameraConfig& start = problem.cameras[i];
      if (!ceres_->HasParameterBlock(camera.lens.data())) continue;
      const int size = NumLensParams(start.lens);
      const std::vector<int> held = HeldLensParams(start.lens, options_.lens);
      if (static_cast<int>(held.size()) == size) {
        ceres_->SetParameterBlockConstant(camera.lens.data());
      } else {
        manifolds_.push_back(std::make_unique<ceres::SubsetManifold>(size, held));
        ceres_->SetManifold(camera.lens.data(), manifolds_.back().get());
        AddParameterPrior(camera.lens.data(), {start.lens_params.begin(), start.lens_params.end()},
                          LensSigmas(start, options_.lens));
      }
      if (!RefinesPort(start.port.type, options_.port)) {
        ceres_->SetParameterBlockConstant(camera.port.data());
        continue;
      }
      manifolds_.push_back(std::make_unique<PortManifold>(start.port.type, options_.port));
      ceres_->SetManifold(camera.port.data(), manifolds_.back().get());
      const PortParams port = start.port.Params();
      AddParameterPrior(camera.port.data(), {port.begin(), port.end()},
                        PortSigmas(start, options_.port),
                        start.port.type == PortType::kFlat ? kPortDistance : -1);
    }
  }

  ceres::Solver::Summary Solve() {
    ceres::Solver::Options solver;
    ChooseSolver(&solver);
    solver.num_threads = options_.num_threads;
    solver.max_num_iterations = options_.max_iterations;
    solver.function_tolerance = options_.function_tolerance;
    solver.gradient_tolerance = 1e-12;
    solver.parameter_tolerance = 1e-10;
    solver.logging_type = ceres::SILENT;
    solver.update_state_every_iteration = false;
    if (options_.adjust_points_within) {
      solver.initial_trust_region_radius = 1e5;  // longer steps are good ones then
      auto points = std::make_shared<ceres::ParameterBlockOrdering>();
      for (Vec3& point : points_)
        if (ceres_->HasParameterBlock(point.data())) points->AddElementToGroup(point.data(), 0);
      solver.use_inner_iterations = true;
      solver.inner_iteration_ordering = points;
      solver.inner_iteration_tolerance = 1e-7;
    }
    ProgressCallback callback(options_);
    solver.callbacks.push_back(&callback);
    ceres::Solver::Summary summary;
    ceres::Solve(solver, ceres_.get(), &summary);
    return summary;
  }

  void CopyTo(BundleProblem* problem) {
    for (std::size_t i = 0; i < poses_.size(); ++i) {
      Rigid3& pose = problem->images[i].camera_from_world;
      pose = FromBlock(poses_[i].data());
      pose.rotation.normalize();
    }
    problem->points = points_;
    for (std::size_t i = 0; i < cameras_.size(); ++i) {
      cameras_[i]->Update();
      problem->cameras[i] = cameras_[i]->config;
    }
  }

 private:
  void AddParameterPrior(double* block, std::vector<double> start, std::vector<double> sigma,
                         int ratio = -1) {
    costs_.push_back(
        std::make_unique<ParameterPriorCost>(std::move(start), std::move(sigma), ratio));
    ceres_->AddResidualBlock(costs_.back().get(), nullptr, block);
  }

  // Points are eliminated first. Few images: a dense reduced system; more: a sparse one, which
  // surveys keep sparse; very many: conjugate gradients on it.
  void ChooseSolver(ceres::Solver::Options* solver) {
    const std::size_t num_images = poses_.size();
    solver->linear_solver_type = num_images <= 60     ? ceres::DENSE_SCHUR
                                 : num_images <= 2500 ? ceres::SPARSE_SCHUR
                                                      : ceres::ITERATIVE_SCHUR;
    solver->preconditioner_type = ceres::SCHUR_JACOBI;
    auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
    for (Vec3& point : points_)
      if (ceres_->HasParameterBlock(point.data())) ordering->AddElementToGroup(point.data(), 0);
    for (PoseBlock& pose : poses_)
      if (ceres_->HasParameterBlock(pose.data())) ordering->AddElementToGroup(pose.data(), 1);
    for (const auto& camera : cameras_) {
      for (double* block : {camera->lens.data(), camera->port.data()})
        if (ceres_->HasParameterBlock(block)) ordering->AddElementToGroup(block, 1);
    }
    solver->linear_solver_ordering = ordering;
  }

  const BundleOptions& options_;
  std::vector<std::unique_ptr<CameraState>> cameras_;
  std::vector<PoseBlock> poses_;
  std::vector<Vec3> points_;
  std::vector<std::unique_ptr<ceres::CostFunction>> costs_;
  std::unique_ptr<ceres::LossFunction> loss_;
  std::vector<std::unique_ptr<ceres::LossFunction>> losses_;
  PoseManifold pose_manifold_;
  std::vector<std::unique_ptr<ceres::Manifold>> manifolds_;
  std::unique_ptr<ceres::Problem> ceres_;
};

}  // namespace

Expected<BundleReport> AdjustBundleByCeres(const BundleOptions& options, BundleProblem* problem) {
  const bool caller_holds = std::any_of(problem->images.begin(), problem->images.end(),
                                        [](const BundleImage& image) { return image.fixed; });
  GaugeHold hold;
  if (!caller_holds) hold = HoldGauge(*problem, options.scale_sigma);

  BundleReport report;
  report.gauge = hold.gauge;
  report.initial_mean_error_px = SummariseErrors(*problem)->mean_px;
  Adjustment adjustment(options, *problem);
  adjustment.AddObservations(*problem);
  adjustment.AddPriors(problem->priors);
  adjustment.AddPriors(hold.priors);
  adjustment.SetPoseManifolds(*problem);
  adjustment.SetCameraManifolds(*problem);
  const ceres::Solver::Summary summary = adjustment.Solve();
  if (!summary.IsSolutionUsable()) return Fail(Errc::kNotConverged, "bundle adjustment");
  adjustment.CopyTo(problem);

  report.converged = summary.termination_type == ceres::CONVERGENCE;
  report.interrupted = summary.termination_type == ceres::USER_SUCCESS;
  report.iterations = static_cast<int>(summary.iterations.size()) - 1;
  report.initial_cost = summary.initial_cost;
  report.final_cost = summary.final_cost;
  const ErrorSummary errors = *SummariseErrors(*problem);
  report.final_mean_error_px = errors.mean_px;
  report.num_impossible = errors.num_impossible;
  report.seconds = summary.total_time_in_seconds;
  report.solver = ceres::LinearSolverTypeToString(summary.linear_solver_type_used);
  return report;
}

}  // namespace rsfm

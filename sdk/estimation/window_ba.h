// Window bundle adjustment in fixed memory: the poses of a few keyframes and the landmarks they
// see, by the true image error, navigation and what is remembered of earlier windows.
//
// Levenberg-Marquardt on the normal equations with the landmarks eliminated (Schur complement).
// [Triggs 1999, "Bundle Adjustment: A Modern Synthesis", sec. 6.1; Nielsen 1999, IMM-REP-1999-05,
// for the damping] The cost and the damping are those of Ceres, so both reach the same optimum.
//
//   WindowBa ba = *WindowBa::Create(capacity);   // the only place that allocates
//   ba.Clear(); ba.AddKeyframe(...); ba.AddLandmark(...); ba.AddObservation(...); ba.AddPrior(...);
//   ba.Solve(cameras, options);
//   ba.camera_from_world(k); ba.point_in_world(l); ba.PoseCovariance(k);
//
// With navigation factors (nav_factor.h) the sensors' errors are unknowns too. What leaves a window
// is kept by Marginalise() and goes into the next one by SetMarginalPrior().
//
// Deterministic: the same calls give the same bits. Not thread-safe.
#pragma once

#include <cstdint>
#include <span>

#include "rsfm/base/error.h"
#include "rsfm/base/fixed_vector.h"
#include "rsfm/base/rigid3.h"
#include "rsfm/estimation/block_cholesky.h"
#include "rsfm/estimation/marginal_prior.h"
#include "rsfm/estimation/nav_factor.h"
#include "rsfm/estimation/pose_prior.h"
#include "rsfm/estimation/robust_loss.h"
#include "rsfm/refraction/any_camera.h"

namespace rsfm {

struct WindowBaCapacity {
  int keyframes = 16;
  int landmarks = 3000;
  int observations = 20000;
  int priors = 128;
  int nav_factors = 1;

  Status Validate() const noexcept;
};

struct WindowBaOptions {
  int max_iterations =
      20;  // the time bound: so many evaluations and so many linear solves, at most
  RobustLoss loss{LossType::kHuber, 1.0};  // of the image errors; scale in units of their sigma
  double function_tolerance = 1e-6;        // stop when the cost falls by less than this fraction
  double gradient_tolerance = 1e-10;       // stop when no entry of the gradient is larger
  double parameter_tolerance = 1e-8;       // stop when the step is smaller than this fraction
  double initial_trust_radius = 1e4;

  Status Validate() const noexcept;
};

enum class WindowBaEnd : std::uint8_t {
  kConverged,       // one of the tolerances was met
  kIterationLimit,  // better than before, but the bound was reached first
  kStuck,           // no step lowers the cost any further
};

struct WindowBaReport {
  WindowBaEnd end = WindowBaEnd::kIterationLimit;
  int iterations = 0;         // linear solves
  double initial_cost = 0.0;  // sum of rho(|r|^2) / 2 over observations and priors
  double final_cost = 0.0;
  int num_observations = 0;
  int num_impossible = 0;      // that could not be projected at the end: no weight, a constant cost
  double mean_error_px = 0.0;  // of the others
  double rms_error_px = 0.0;
};

class WindowBa {
 public:
  // kInvalidArgument when a capacity is not positive.
  static Expected<WindowBa> Create(const WindowBaCapacity& capacity);
  std::size_t bytes() const;  // on the heap, for the memory plan

  void Clear();

  // Each returns the index, counted from 0 since Clear(). kOutOfCapacity when full;
  // kInvalidArgument when a number is not finite, with `where` naming it.
  Expected<int> AddKeyframe(const Rigid3& camera_from_world, int camera = 0, bool fixed = false);
  Expected<int> AddLandmark(const Vec3& point_in_world, bool fixed = false);
  // Also kNotFound for a keyframe or landmark that does not exist.
  Expected<int> AddObservation(int keyframe, int landmark, const Vec2& pixel,
                               double sigma_px = 1.0);
  Expected<int> AddPrior(const PosePrior& prior);
  // A range from the body straight down in the world to a landmark there: the third coordinate of
  // the landmark less the body's is `altitude_m`. Counts as an observation.
  Expected<int> AddAltitude(int keyframe, int landmark, const Rigid3& body_from_camera,
                            double altitude_m, double sigma_m);
  // Needs SetMarginalPrior with states before.
  Expected<int> AddNavFactor(const NavFactor& factor);
  // What earlier windows left: `keyframe_of[i]` is the keyframe of the prior's i-th pose, free and
  // in ascending order. With states, these become unknowns that start at `states`. Copies; call
  // once, after the keyframes.
  //   kInvalidArgument  keyframe_of does not fit
  Status SetMarginalPrior(const MarginalPrior& prior, std::span<const int> keyframe_of,
                          const NavStates& states);

  // Adjusts all free poses and landmarks. Derivatives to poses that the marginal prior knows are
  // taken at its first estimates [Huang 2009, ISER, "A first-estimates Jacobian EKF"]. `cameras`
  // are what the keyframes' camera indices mean. On error everything is as it was:
  //   kInvalidArgument  an option, or a keyframe whose camera is not in `cameras`
  //   kNotEnoughData    no observation and no prior
  //   kDegenerate       nothing holds the poses in the world: no fixed keyframe, no absolute prior
  // A scale that nothing holds (one fixed pose, no port, no baseline) is left where it starts.
  Expected<WindowBaReport> Solve(std::span<const AnyCamera> cameras,
                                 const WindowBaOptions& options) noexcept;

  // Sums up everything that was added as a prior on what stays: all free keyframes but the first
  // `num_gone`, and the states. Fixed keyframes come last. Residuals and robust weights are those
  // of the present poses; derivatives are taken at the first estimate of a pose that the marginal
  // prior knows, else at the present pose, which becomes its first estimate.
  //   kInvalidArgument  num_gone, a free keyframe after a fixed one, or a camera index
  //   kDegenerate       a number is not finite; `result` is untouched on any error
  Status Marginalise(std::span<const AnyCamera> cameras, const RobustLoss& loss, int num_gone,
                     MarginalPrior* result) noexcept;

  int num_keyframes() const { return static_cast<int>(poses_.size()); }
  int num_landmarks() const { return static_cast<int>(points_.size()); }
  int num_observations() const { return static_cast<int>(observations_.size()); }
  const Rigid3& camera_from_world(int keyframe) const { return poses_[keyframe]; }
  const Vec3& point_in_world(int landmark) const { return points_[landmark]; }
  const NavStates& nav_states() const { return states_; }

  // After Solve: how each observation ended and its error. The error of one that is not kOk is 0.
  Projection observation_status(int observation) const { return current_.status[observation]; }
  double observation_error_px(int observation) const { return current_.error_px[observation]; }

  // After Solve: the covariance of one pose's (rotation, translation) perturbation with all other
  // unknowns marginalised out, for image noise of the stated sigmas. Zero for a fixed pose.
  //   kNotFound    no such keyframe, or Solve has not run
  //   kDegenerate  the data do not determine it (a free scale, an unobserved pose)
  Expected<Mat6> PoseCovariance(int keyframe) noexcept;
  // Likewise of the first six sensor states. kNotFound without states.
  Expected<Mat6> NavStateCovariance() noexcept;

 private:
  using Mat63 = Eigen::Matrix<double, 6, 3>;

  struct Keyframe {
    int camera = 0;
    int block = -1;  // among the free poses, -1 when fixed
    bool fixed = false;
  };
  struct Observation {
    int keyframe = 0;
    int landmark = 0;
    Vec2 pixel = Vec2::Zero();
    double inverse_sigma = 1.0;
    bool is_altitude = false;  // then pixel is (altitude [m], 0) and the next is meant
    Vec3 body_in_camera = Vec3::Zero();
  };
  // Everything that is known at one state of the unknowns.
  struct Linearisation {
    double cost = 0.0;
    FixedVector<Mat6> pose_hessian;   // per keyframe, from its observations
    FixedVector<Vec6> pose_gradient;  // per keyframe
    FixedVector<Mat3> point_hessian;
    FixedVector<Vec3> point_gradient;
    FixedVector<Mat63> cross;  // per entry of order_: pose x point
    FixedVector<PriorEvaluation> priors;
    FixedVector<NavEvaluation> nav;
    NavStateHessian state_hessian = NavStateHessian::Zero();
    NavStates state_gradient = NavStates::Zero();
    FixedVector<Projection> status;  // per observation
    FixedVector<double> error_px;
  };

  // Where derivatives are taken, and how far each pose has gone from there: of poses that the
  // marginal prior knows its first estimates, of others the poses before Solve or Marginalise.
  struct FirstEstimates {
    FixedVector<Rigid3> poses;
    FixedVector<Vec6> moved;
    FixedVector<std::uint8_t> is_known;  // by the prior
    bool at_poses = false;               // residuals are stated at `poses`, else where they are
  };

  explicit WindowBa(const WindowBaCapacity& capacity);
  void Allocate(const WindowBaCapacity& capacity, Linearisation* linearisation) const;
  Status CheckProblem(std::span<const AnyCamera> cameras,
                      const WindowBaOptions& options) const noexcept;
  void SortObservations() noexcept;
  void Linearise(std::span<const AnyCamera> cameras, const RobustLoss& loss,
                 const FixedVector<Rigid3>& poses, const FixedVector<Vec3>& points,
                 const NavStates& states, const FirstEstimates& firsts,
                 Linearisation* at) const noexcept;
  void LineariseLandmark(std::span<const AnyCamera> cameras, const RobustLoss& loss,
                         const FixedVector<Rigid3>& poses, const Vec3& point, int landmark,
                         const FirstEstimates& firsts, Linearisation* at) const noexcept;
  void LineariseAltitude(const Observation& observation, const Rigid3& pose, const Vec3& point,
                         int place, const FirstEstimates& firsts, Mat3* point_hessian,
                         Vec3* point_gradient, Linearisation* at) const noexcept;
  void LinearisePriors(const FixedVector<Rigid3>& poses, const FirstEstimates& firsts,
                       Linearisation* at) const noexcept;
  void LineariseNav(const FixedVector<Rigid3>& poses, const NavStates& states,
                    const FirstEstimates& firsts, Linearisation* at) const noexcept;
  void LineariseMarginal(const FixedVector<Rigid3>& poses, const NavStates& states,
                         Linearisation* at) const noexcept;
  int num_blocks() const { return num_free_ + (marginal_.has_states ? kNavBlocks : 0); }
  // The reduced system's block of the marginal prior's.
  int BlockOfMarginal(int i) const noexcept;
  void TakeFirstEstimates(bool at_poses) noexcept;
  void ReduceNav() noexcept;
  void Accumulate(double inverse_radius) noexcept;
  Expected<Mat6> BlockCovariance(int block) noexcept;
  // The reduced system at current_, damped by 1 / radius; false when it has no solution.
  bool Reduce(double inverse_radius) noexcept;
  void EliminateLandmark(int landmark, double inverse_radius) noexcept;
  bool ComputeStep(double inverse_radius) noexcept;
  double PredictedDecrease(double inverse_radius) const noexcept;
  // Writes trial_poses_ and trial_points_; returns the step's length relative to the unknowns'.
  double ApplyStep() noexcept;
  double GradientNorm() const noexcept;
  void Summarise(WindowBaReport* report) const noexcept;

  FixedVector<Keyframe> keyframes_;
  FixedVector<Rigid3> poses_, trial_poses_;
  FixedVector<Vec3> points_, trial_points_;
  FixedVector<std::uint8_t> point_fixed_;
  FixedVector<Observation> observations_;
  FixedVector<PosePrior> priors_;
  FixedVector<NavFactor> nav_factors_;
  NavStates states_ = NavStates::Zero(), trial_states_ = NavStates::Zero();
  MarginalPrior marginal_;        // empty where there is none
  FixedVector<int> marginal_of_;  // keyframe of each of its poses
  FirstEstimates firsts_;         // of all keyframes

  FixedVector<int> order_;  // observations by landmark, then by keyframe
  FixedVector<int> first_;  // of each landmark in order_, and the end
  int num_free_ = 0;        // poses

  Linearisation current_, trial_;
  BlockCholesky reduced_;
  FixedVector<Mat3> point_inverse_;  // of the damped point Hessian; zero where the point is held
  FixedVector<Vec6> pose_step_;      // per free pose, then the states
  FixedVector<Vec3> point_step_;
  bool solved_ = false;
};

}  // namespace rsfm

#include "tools/offline/navigation_fit.h"

#include <Eigen/Dense>
#include <array>
#include <cmath>
#include <map>
#include <tuple>

#include "rsfm/base/so3.h"

namespace rsfm {
namespace {

constexpr int kLeastImages = 6;
constexpr int kPlace = 0, kLever = 7, kAngle = 10, kClock = 13, kNumUnknowns = 14;
using Unknowns = Eigen::Matrix<double, kNumUnknowns, 1>;

// The pose of a camera once the world was turned, moved and scaled.
Rigid3 InMovedWorld(const Rigid3& camera_from_world, const Unknowns& x) {
  const Quat turn = ExpSo3(x.segment<3>(kPlace));
  const Vec3 place = std::exp(x[kPlace + 6]) * (turn * camera_from_world.OriginOfTarget()) +
                     x.segment<3>(kPlace + 3);
  const Quat rotation = (camera_from_world.rotation * turn.conjugate()).normalized();
  return {rotation, -(rotation * place)};
}

Rigid3 Mounted(const Rigid3& body_from_camera, const Unknowns& x) {
  return {(ExpSo3(x.segment<3>(kAngle)) * body_from_camera.rotation).normalized(),
          body_from_camera.translation + x.segment<3>(kLever)};
}

NavigationInput WithClock(const NavigationInput& given, double ahead_s) {
  NavigationInput shifted = given;
  for (NavSample& sample : shifted.samples) sample.utime -= UsFromSeconds(ahead_s);
  return shifted;
}

using PriorKey = std::tuple<PriorKind, int, int>;
std::map<PriorKey, PosePrior> ByKey(const std::vector<PosePrior>& priors) {
  std::map<PriorKey, PosePrior> by_key;
  for (const PosePrior& prior : priors) by_key[{prior.kind, prior.a, prior.b}] = prior;
  return by_key;
}

Vec6 ResidualOf(PosePrior prior, const Scene& scene, const Unknowns& x) {
  prior.body_from_camera = Mounted(prior.body_from_camera, x);
  const Rigid3 a = InMovedWorld(scene.images[prior.a].camera_from_world, x);
  const Rigid3 b =
      prior.IsRelative() ? InMovedWorld(scene.images[prior.b].camera_from_world, x) : a;
  return EvaluatePrior(prior, a, b).residual;
}

struct NormalEquations {
  Eigen::Matrix<double, kNumUnknowns, kNumUnknowns> information =
      Eigen::Matrix<double, kNumUnknowns, kNumUnknowns>::Zero();
  Unknowns gradient = Unknowns::Zero();
  double chi_squared = 0.0;
  int num_residuals = 0;
};

// Few unknowns, and once per adjustment of the map: differences serve for derivatives.
NormalEquations Linearise(const NavigationInput& now, const Scene& scene, bool with_clock) {
  constexpr double kStep = 1e-5, kClockStep = 0.02;
  std::map<PriorKey, PosePrior> sooner, later;
  if (with_clock) {
    sooner = ByKey(NavigationPriors(WithClock(now, -kClockStep), scene));
    later = ByKey(NavigationPriors(WithClock(now, kClockStep), scene));
  }
  NormalEquations sums;
  const Unknowns zero = Unknowns::Zero();
  for (const PosePrior& prior : NavigationPriors(now, scene)) {
    const Vec6 residual = ResidualOf(prior, scene, zero);
    Eigen::Matrix<double, 6, kNumUnknowns> jacobian;
    for (int i = 0; i < kClock; ++i) {
      const Unknowns step = kStep * Unknowns::Unit(i);
      jacobian.col(i) =
          (ResidualOf(prior, scene, step) - ResidualOf(prior, scene, -step)) / (2.0 * kStep);
    }
    jacobian.col(kClock).setZero();
    const PriorKey key(prior.kind, prior.a, prior.b);
    if (const auto s = sooner.find(key), l = later.find(key);
        s != sooner.end() && l != later.end()) {
      jacobian.col(kClock) =
          (ResidualOf(l->second, scene, zero) - ResidualOf(s->second, scene, zero)) /
          (2.0 * kClockStep);
    }
    const double weight = prior.loss.Weight(residual.squaredNorm());
    sums.information += weight * jacobian.transpose() * jacobian;
    sums.gradient += weight * jacobian.transpose() * residual;
    sums.chi_squared += weight * residual.squaredNorm();
    sums.num_residuals += prior.Dimension();
  }
  return sums;
}

// The places and times alone.
Scene WithoutFeatures(const Scene& scene) {
  Scene bare;
  for (const SceneImage& image : scene.images) {
    bare.images.emplace_back();
    bare.images.back().utime = image.utime;
    bare.images.back().placed = image.placed;
    bare.images.back().camera_from_world = image.camera_from_world;
  }
  return bare;
}

}  // namespace

NavigationAlignment NavigationFit::Apply(Scene* scene) {
  NavigationAlignment alignment = AlignToNavigation(now_, scene);
  estimates_.clear();
  if (options_.Any() && alignment.attitude && scene->NumPlaced() >= kLeastImages) {
    Estimate(WithoutFeatures(*scene), alignment.scale);
    const double scale = alignment.scale_factor;
    alignment = AlignToNavigation(now_, scene);
    alignment.scale_factor *= scale;
  }
  // Priors of a world that could not be turned into navigation's frame would bend it.
  scene->priors = alignment.attitude ? NavigationPriors(now_, *scene) : std::vector<PosePrior>();
  return alignment;
}

// Gauss and Newton on what is asked for and on the place of the map as a whole, whose shape stays.
void NavigationFit::Estimate(Scene scene, bool has_scale) {
  constexpr int kIterations = 5;
  constexpr double kHeld = 1e12, kLoose = 1e-9;
  const auto squared = [](double sigma) { return 1.0 / (sigma * sigma); };
  Unknowns prior = Unknowns::Constant(kLoose);
  if (!has_scale) prior[kPlace + 6] = kHeld;
  prior.segment<3>(kLever).setConstant(options_.mount ? squared(options_.sigma_lever_arm_m)
                                                      : kHeld);
  prior.segment<3>(kAngle).setConstant(options_.mount ? squared(options_.sigma_angle_rad) : kHeld);
  prior[kClock] = options_.clock ? squared(options_.sigma_clock_s) : kHeld;
  Eigen::MatrixXd covariance;
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    NormalEquations sums = Linearise(now_, scene, options_.clock);
    Unknowns from_given = Unknowns::Zero();
    from_given.segment<3>(kLever) =
        now_.body_from_camera.translation - given_.body_from_camera.translation;
    from_given.segment<3>(kAngle) =
        LogSo3(now_.body_from_camera.rotation * given_.body_from_camera.rotation.conjugate());
    from_given[kClock] = clock_s_;
    const double noise =
        std::max(1.0, sums.chi_squared / std::max(1, sums.num_residuals - kNumUnknowns));
    sums.information.diagonal() += prior;
    sums.gradient += prior.cwiseProduct(from_given);
    const auto factor = sums.information.ldlt();
    const Unknowns step = -factor.solve(sums.gradient);
    if (factor.info() != Eigen::Success || !step.allFinite()) return;
    covariance = noise * factor.solve(Eigen::MatrixXd::Identity(kNumUnknowns, kNumUnknowns));
    for (SceneImage& image : scene.images)
      if (image.placed) image.camera_from_world = InMovedWorld(image.camera_from_world, step);
    now_.body_from_camera = Mounted(now_.body_from_camera, step);
    if (options_.clock) {
      clock_s_ += step[kClock];
      now_.samples = WithClock(given_, clock_s_).samples;
    }
    if (step.segment<7>(kLever).norm() < 1e-6) break;
  }
  Describe(covariance);
}

void NavigationFit::Describe(const Eigen::MatrixXd& covariance) {
  const auto add = [&](ParameterKind kind, const char* name, double start, double value, int index,
                       double prior_sigma) {
    const double sigma = std::min(prior_sigma, std::sqrt(covariance(index, index)));
    estimates_.push_back(
        {kind, name, start, value, sigma, prior_sigma, 0.0, Verdict(sigma, prior_sigma)});
  };
  if (options_.mount) {
    static constexpr std::array<const char*, 6> kNames = {
        "mount.x_m", "mount.y_m", "mount.z_m", "mount.turn_x", "mount.turn_y", "mount.turn_z"};
    const Vec3 turn =
        LogSo3(now_.body_from_camera.rotation * given_.body_from_camera.rotation.conjugate());
    for (int i = 0; i < 3; ++i)
      add(ParameterKind::kMount, kNames[i], given_.body_from_camera.translation[i],
          now_.body_from_camera.translation[i], kLever + i, options_.sigma_lever_arm_m);
    for (int i = 0; i < 3; ++i)
      add(ParameterKind::kMount, kNames[3 + i], 0.0, turn[i], kAngle + i, options_.sigma_angle_rad);
  }
  if (options_.clock)
    add(ParameterKind::kClock, "clock_s", 0.0, clock_s_, kClock, options_.sigma_clock_s);
}

}  // namespace rsfm

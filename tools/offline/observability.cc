#include "tools/offline/observability.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "tools/offline/bend.h"
#include "tools/offline/bundle_information.h"

namespace rsfm {
namespace {

// What holds the gauge where the caller holds nothing.
GaugeHold HoldFor(const BundleOptions& options, const BundleProblem& problem) {
  const bool caller_holds = std::any_of(problem.images.begin(), problem.images.end(),
                                        [](const BundleImage& image) { return image.fixed; });
  return caller_holds ? GaugeHold() : HoldGauge(problem, options.scale_sigma);
}

// Nothing where the cameras do not look one way, or their places have no extent.
std::optional<BendEstimate> EstimateBend(const BundleProblem& problem,
                                         const BundleInformation& information) {
  constexpr double kOneWay = 0.8;  // length of the mean of the directions of view
  std::vector<Vec3> places;
  Vec3 up = Vec3::Zero();
  for (const BundleImage& image : problem.images) {
    places.push_back(image.camera_from_world.OriginOfTarget());
    up -= image.camera_from_world.rotation.conjugate() * Vec3::UnitZ();
  }
  if (up.norm() < kOneWay * static_cast<double>(places.size())) return std::nullopt;
  const auto bend = FitBend(places, up);
  if (!bend) return std::nullopt;
  const double variance = information.Variance(information.PlacesGradient(bend->weights));
  if (!std::isfinite(variance)) return std::nullopt;
  return BendEstimate{bend->sagitta_m, std::sqrt(variance), bend->radius_m, bend->along_line};
}

// Of what bends maps most: focal length, port normal, dome centre. The port's distance goes with
// the scale and is no more than that says.
bool WasHeld(ParameterKind kind, const BundleOptions& options) {
  switch (kind) {
    case ParameterKind::kFocal:
      return !options.lens.focal;
    case ParameterKind::kNormal:
      return !options.port.normal;
    case ParameterKind::kCenter:
      return !options.port.center;
    default:
      return false;
  }
}

// One step of what was held, all else following. With the noise as it was asked, and adjusted to
// that: what a wrong camera leaves in the errors a loss fitted to them takes for outliers.
void DoubtHeld(const BundleOptions& asked, BundleProblem solved, bool is_fitted,
               ObservabilityReport* report) {
  if (is_fitted && !AdjustBundle(asked, &solved)) return;
  BundleOptions freed = asked;
  freed.lens.focal = true;
  freed.port.normal = freed.port.center = true;
  BundleInformation information(freed, solved.cameras, solved);
  information.AddPriors(HoldFor(asked, solved).priors);
  if (!information.Factorise()) return;
  const Eigen::MatrixXd pulls = information.PullsOfImages();
  const Eigen::VectorXd step = information.ParameterStep(pulls);
  const Eigen::MatrixXd covariance =
      information.covariance() + information.ClusteredCovariance(pulls);
  std::vector<int> held;
  for (int i = 0; i < information.num_parameters(); ++i) {
    const ParameterEstimate& e = information.estimates()[i];
    if (!WasHeld(e.kind, asked)) continue;
    held.push_back(i);
    report->held.push_back({e.kind, e.name, e.value, step[i], std::sqrt(covariance(i, i))});
  }
  if (held.empty()) return;
  const Eigen::VectorXd steps = step(held);
  const double chi_squared = steps.dot(covariance(held, held).llt().solve(steps));
  report->held_sigmas = std::sqrt(chi_squared / static_cast<double>(held.size()));
}

}  // namespace

std::string Verdict(double sigma, double prior_sigma) {
  const double ratio = sigma / prior_sigma;
  if (!(ratio < 0.9)) return "not determined";
  if (ratio < 0.1) return "well determined";
  return ratio < 0.5 ? "determined" : "weakly determined";
}

Expected<ObservabilityReport> AnalyseObservability(const BundleOptions& options,
                                                   const BundleOptions& asked,
                                                   const std::vector<CameraConfig>& start,
                                                   const BundleProblem& solved) {
  if (start.size() != solved.cameras.size()) return Fail(Errc::kInvalidArgument, "start");
  BundleInformation held(options, start, solved);
  ObservabilityReport report;
  report.noise_px = held.noise_px();
  // The scale set free, but for a hold of 100 % that keeps the system regular.
  BundleInformation free = held;
  for (PosePrior prior : HoldFor(options, solved).priors) {
    held.AddPriors({prior});
    if (prior.kind == PriorKind::kBaseline)
      prior.sqrt_information(0, 0) = 1.0 / prior.measured.translation.x();
    free.AddPriors({prior});
  }
  Eigen::VectorXd with_scale;
  if (!free.Factorise()) return Fail(Errc::kDegenerate, "poses");
  report.scale_sigma = std::sqrt(free.Variance(free.ScaleGradient(FarPair(solved)), &with_scale));
  if (!std::isfinite(report.scale_sigma) || !with_scale.allFinite() || !held.Factorise())
    return Fail(Errc::kDegenerate, "poses");
  report.bend = EstimateBend(solved, held);
  const Eigen::MatrixXd& covariance = held.covariance();
  const Eigen::MatrixXd clustered = held.ClusteredCovariance(held.PullsOfImages());
  report.parameters = held.estimates();
  for (int i = 0; i < held.num_parameters(); ++i) {
    ParameterEstimate& estimate = report.parameters[i];
    estimate.sigma = std::sqrt(std::max(covariance(i, i), clustered(i, i)));
    estimate.scale_correlation = with_scale[i];
    estimate.verdict = Verdict(estimate.sigma, estimate.prior_sigma);
  }
  DoubtHeld(asked, solved, options.sigma_px != asked.sigma_px, &report);
  return report;
}

}  // namespace rsfm

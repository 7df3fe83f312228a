#include "tools/offline/bundle_information.h"

#include <Eigen/Sparse>
#include <algorithm>
#include <cmath>
#include <sstream>

#include "tools/offline/camera_unknowns.h"

namespace rsfm {
namespace {

using Mat63 = Eigen::Matrix<double, 6, 3>;

const char* const kFlatNames[] = {"port.normal_x",    "port.normal_y",    "port.normal_z",
                                  "port.distance_m",  "port.thickness_m", "port.index_air",
                                  "port.index_glass", "port.index_water"};
const char* const kDomeNames[] = {"port.center_x_m",  "port.center_y_m",  "port.center_z_m",
                                  "port.radius_m",    "port.thickness_m", "port.index_air",
                                  "port.index_glass", "port.index_water"};

ParameterKind KindOfLens(std::string_view name) {
  if (name.starts_with("f")) return ParameterKind::kFocal;
  return name.starts_with("c") ? ParameterKind::kPrincipalPoint : ParameterKind::kDistortion;
}

// In the order of PortConfig::Params().
ParameterKind KindOfPort(PortType type, Eigen::Index index) {
  if (index >= 4) return ParameterKind::kIndex;  // of the others none is ever refined
  if (type == PortType::kDome) return ParameterKind::kCenter;
  return index < 3 ? ParameterKind::kNormal : ParameterKind::kDistance;
}

}  // namespace

BundleInformation::BundleInformation(const BundleOptions& options,
                                     const std::vector<CameraConfig>& start,
                                     const BundleProblem& problem)
    : options_(options), problem_(problem) {
  for (std::size_t c = 0; c < problem.cameras.size(); ++c) AddCamera(c, start[c]);
  pose_block_.resize(problem.images.size(), -1);
  for (std::size_t i = 0; i < problem.images.size(); ++i)
    if (!problem.images[i].fixed) pose_block_[i] = num_poses_++;
  const int count = num_parameters();
  pose_by_parameter_ = MatrixXd::Zero(6 * num_poses_, count);
  parameters_by_parameters_ = MatrixXd::Zero(count, count);
  for (const CameraConfig& config : problem.cameras) cameras_.push_back(*AnyCamera::Create(config));
  EstimateNoise();
  for (const std::vector<int>& observations : OfPoints()) EliminatePoint(observations);
  AddPriors(problem.priors);
  for (int i = 0; i < count; ++i)
    parameters_by_parameters_(i, i) += 1.0 / std::pow(estimates_[i].prior_sigma, 2);
}

void BundleInformation::AddCamera(std::size_t index, const CameraConfig& start) {
  const CameraConfig& now = problem_.cameras[index];
  const std::string prefix =
      problem_.cameras.size() > 1 ? "camera " + std::to_string(index) + ": " : "";
  CameraColumns columns;
  columns.first = num_parameters();
  const std::vector<int> held = HeldLensParams(now.lens, options_.lens);
  const std::vector<double> lens_sigma = LensSigmas(start, options_.lens);
  std::istringstream names{std::string(LensParamNames(now.lens))};
  std::vector<int> lens_free;
  for (int i = 0; i < NumLensParams(now.lens); ++i) {
    std::string name;
    names >> name;
    if (std::find(held.begin(), held.end(), i) != held.end()) continue;
    lens_free.push_back(i);
    estimates_.push_back({KindOfLens(name), prefix + name, start.lens_params[i], now.lens_params[i],
                          0.0, lens_sigma[i], 0.0, ""});
  }
  const int num_lens = static_cast<int>(lens_free.size());
  int num_port = 0;
  MatrixXd plus;
  if (RefinesPort(now.port.type, options_.port)) {
    const CameraUnknowns unknowns(options_, {now});
    plus = unknowns.PortColumns(0, now);
    num_port = static_cast<int>(plus.cols());
    const std::vector<double> port_sigma = PortSigmas(now, options_.port);
    const PortParams before = start.port.Params(), after = now.port.Params();
    for (int i = 0; i < num_port; ++i) {
      // Each tangent direction is named by the parameter that it moves the most, upwards.
      Eigen::Index moved = 0;
      plus.col(i).cwiseAbs().maxCoeff(&moved);
      if (plus(moved, i) < 0.0) plus.col(i) *= -1.0;
      estimates_.push_back(
          {KindOfPort(now.port.type, moved),
           prefix + (now.port.type == PortType::kFlat ? kFlatNames : kDomeNames)[moved],
           before[moved], after[moved], 0.0, port_sigma[moved], 0.0, ""});
    }
  }
  columns.count = num_lens + num_port;
  columns.lens_to_column = MatrixXd::Zero(kMaxLensParams, columns.count);
  columns.port_to_column = MatrixXd::Zero(kNumPortParams, columns.count);
  for (int i = 0; i < num_lens; ++i) columns.lens_to_column(lens_free[i], i) = 1.0;
  if (num_port > 0) columns.port_to_column.rightCols(num_port) = plus;
  columns_.push_back(std::move(columns));
}

void BundleInformation::AddBlock(int row, int column, const Mat6& block) {
  if (row < 0 || column < 0) return;
  const bool lower = row >= column;
  const std::uint64_t key = (static_cast<std::uint64_t>(lower ? row : column) << 32) |
                            static_cast<std::uint32_t>(lower ? column : row);
  const auto [place, is_new] = blocks_.try_emplace(key, Mat6::Zero());
  if (lower) {
    place->second += block;
  } else {
    place->second += block.transpose();
  }
}

// The noise is what the residuals show, robustly weighted; the image errors' information is
// scaled by it, that of the priors is taken at its word.
void BundleInformation::EstimateNoise() {
  double sum = 0.0;
  for (const BundleObservation& o : problem_.observations) {
    const BundleImage& image = problem_.images[o.image];
    Vec2 error;
    if (ReprojectionError(cameras_[image.camera], image.camera_from_world, problem_.points[o.point],
                          o.pixel, &error) != Projection::kOk)
      continue;
    sum += options_.loss.Weight(error.squaredNorm() / std::pow(options_.sigma_px, 2)) *
           error.squaredNorm();
  }
  const double redundancy = 2.0 * static_cast<double>(problem_.observations.size()) -
                            3.0 * static_cast<double>(problem_.points.size()) - 6.0 * num_poses_ -
                            num_parameters();
  noise_px_ = std::max(1e-6, std::sqrt(sum / std::max(1.0, redundancy)));
}

// False where the observation has no projection.
bool BundleInformation::Linearise(int index, Linearised* result) const {
  const BundleObservation& o = problem_.observations[index];
  const BundleImage& image = problem_.images[o.image];
  ReprojectionJacobian j;
  if (ReprojectionError(cameras_[image.camera], image.camera_from_world, problem_.points[o.point],
                        o.pixel, &result->error, &j) != Projection::kOk)
    return false;
  result->image = o.image;
  result->block = pose_block_[o.image];
  result->weight =
      options_.loss.Weight(result->error.squaredNorm() / std::pow(options_.sigma_px, 2)) /
      (noise_px_ * noise_px_);
  result->d_pose = j.d_error_d_pose;
  result->d_point = j.d_error_d_point;
  const CameraColumns& columns = columns_[image.camera];
  result->d_parameters = MatrixXd::Zero(2, num_parameters());
  result->d_parameters.middleCols(columns.first, columns.count) =
      j.d_error_d_lens * columns.lens_to_column + j.d_error_d_port * columns.port_to_column;
  return true;
}

std::vector<std::vector<int>> BundleInformation::OfPoints() const {
  std::vector<std::vector<int>> of_point(problem_.points.size());
  for (std::size_t i = 0; i < problem_.observations.size(); ++i)
    of_point[problem_.observations[i].point].push_back(static_cast<int>(i));
  return of_point;
}

void BundleInformation::EliminatePoint(const std::vector<int>& observations) {
  Mat3 point_information = Mat3::Zero();
  MatrixXd point_by_parameter = MatrixXd::Zero(3, num_parameters());
  std::vector<std::pair<int, Mat63>> cross;
  for (const int index : observations) {
    Linearised o;
    if (!Linearise(index, &o)) continue;
    point_information += o.weight * o.d_point.transpose() * o.d_point;
    point_by_parameter += o.weight * o.d_point.transpose() * o.d_parameters;
    parameters_by_parameters_ += o.weight * o.d_parameters.transpose() * o.d_parameters;
    if (o.block < 0) continue;
    AddBlock(o.block, o.block, o.weight * o.d_pose.transpose() * o.d_pose);
    pose_by_parameter_.middleRows<6>(6 * o.block) +=
        o.weight * o.d_pose.transpose() * o.d_parameters;
    cross.emplace_back(o.block, o.weight * o.d_pose.transpose() * o.d_point);
  }
  const Eigen::LLT<Mat3> factor(point_information);
  if (factor.info() != Eigen::Success) return;  // a point without depth says nothing here
  const Mat3 inverse = factor.solve(Mat3::Identity());
  for (const auto& [row, w] : cross) {
    const Mat63 eliminated = w * inverse;
    for (const auto& [column, v] : cross)
      if (row >= column) AddBlock(row, column, -eliminated * v.transpose());
    pose_by_parameter_.middleRows<6>(6 * row) -= eliminated * point_by_parameter;
  }
  parameters_by_parameters_ -= point_by_parameter.transpose() * inverse * point_by_parameter;
}

void BundleInformation::AddPriors(const std::vector<PosePrior>& priors) {
  for (const PosePrior& prior : priors) {
    const Rigid3& a = problem_.images[prior.a].camera_from_world;
    const Rigid3& b = problem_.images[prior.IsRelative() ? prior.b : prior.a].camera_from_world;
    const PriorEvaluation e = EvaluatePrior(prior, a, b);
    const double weight = prior.loss.Weight(e.residual.squaredNorm());
    AddBlock(pose_block_[prior.a], pose_block_[prior.a],
             weight * e.d_residual_d_a.transpose() * e.d_residual_d_a);
    if (!prior.IsRelative()) continue;
    AddBlock(pose_block_[prior.b], pose_block_[prior.b],
             weight * e.d_residual_d_b.transpose() * e.d_residual_d_b);
    AddBlock(pose_block_[prior.a], pose_block_[prior.b],
             weight * e.d_residual_d_a.transpose() * e.d_residual_d_b);
  }
}

struct BundleInformation::Factor {
  Eigen::SimplicialLLT<Eigen::SparseMatrix<double>, Eigen::Lower> poses;
};

bool BundleInformation::Factorise() {
  std::vector<Eigen::Triplet<double>> entries;
  for (const auto& [key, block] : blocks_) {
    const int row = static_cast<int>(key >> 32), column = static_cast<int>(key & 0xFFFFFFFFu);
    for (int i = 0; i < 6; ++i)
      for (int j = 0; j < 6; ++j)
        if (6 * row + i >= 6 * column + j)
          entries.emplace_back(6 * row + i, 6 * column + j, block(i, j));
  }
  Eigen::SparseMatrix<double> matrix(6 * num_poses_, 6 * num_poses_);
  matrix.setFromTriplets(entries.begin(), entries.end());
  const auto factor = std::make_shared<Factor>();
  factor->poses.compute(matrix);
  if (factor->poses.info() != Eigen::Success) return false;
  factor_ = factor;
  poses_through_parameters_ = factor_->poses.solve(pose_by_parameter_);
  const Eigen::LLT<MatrixXd> parameter_factor(
      parameters_by_parameters_ - pose_by_parameter_.transpose() * poses_through_parameters_);
  if (parameter_factor.info() != Eigen::Success) return false;
  covariance_ = parameter_factor.solve(MatrixXd::Identity(num_parameters(), num_parameters()));
  return covariance_.allFinite();
}

double BundleInformation::Variance(const VectorXd& gradient, VectorXd* correlation) const {
  const VectorXd through = poses_through_parameters_.transpose() * gradient;
  const VectorXd shared = covariance_ * through;
  const double variance = gradient.dot(factor_->poses.solve(gradient)) + through.dot(shared);
  if (correlation != nullptr)
    *correlation = -shared.array() / (covariance_.diagonal().array().sqrt() * std::sqrt(variance));
  return variance;
}

BundleInformation::VectorXd BundleInformation::ScaleGradient(const std::array<int, 2>& pair) const {
  VectorXd gradient = VectorXd::Zero(6 * num_poses_);
  if (pair[0] < 0) return gradient;
  const Rigid3& a = problem_.images[pair[0]].camera_from_world;
  const Rigid3& b = problem_.images[pair[1]].camera_from_world;
  const double length = (a.OriginOfTarget() - b.OriginOfTarget()).norm();
  const PriorEvaluation e =
      EvaluatePrior(*MakeBaselinePrior(pair[0], pair[1], Rigid3(), length, length), a, b);
  for (const auto& [image, row] : {std::pair(pair[0], e.d_residual_d_a.row(0).eval()),
                                   std::pair(pair[1], e.d_residual_d_b.row(0).eval())})
    if (pose_block_[image] >= 0) gradient.segment<6>(6 * pose_block_[image]) += row.transpose();
  return gradient;
}

BundleInformation::VectorXd BundleInformation::PlacesGradient(
    const std::vector<Vec3>& weights) const {
  VectorXd gradient = VectorXd::Zero(6 * num_poses_);
  for (std::size_t i = 0; i < weights.size(); ++i) {
    if (pose_block_[i] < 0) continue;
    const Rigid3& pose = problem_.images[i].camera_from_world;
    const PriorEvaluation e = EvaluatePrior(
        *MakePositionPrior(static_cast<int>(i), Rigid3(), pose.OriginOfTarget(), Vec3::Ones()),
        pose, pose);
    gradient.segment<6>(6 * pose_block_[i]) +=
        e.d_residual_d_a.topRows<3>().transpose() * weights[i];
  }
  return gradient;
}

BundleInformation::MatrixXd BundleInformation::PullsOfImages() const {
  MatrixXd pulls =
      MatrixXd::Zero(num_parameters(), static_cast<Eigen::Index>(problem_.images.size()));
  if (num_parameters() == 0) return pulls;
  std::vector<Linearised> of_point;
  for (const std::vector<int>& observations : OfPoints()) {
    of_point.clear();
    Mat3 information = Mat3::Zero();
    MatrixXd by_parameter = MatrixXd::Zero(3, num_parameters());
    for (const int index : observations) {
      Linearised o;
      if (!Linearise(index, &o)) continue;
      if (o.block >= 0)
        o.d_parameters -= o.d_pose * poses_through_parameters_.middleRows<6>(6 * o.block);
      information += o.weight * o.d_point.transpose() * o.d_point;
      by_parameter += o.weight * o.d_point.transpose() * o.d_parameters;
      of_point.push_back(std::move(o));
    }
    const Eigen::LLT<Mat3> factor(information);
    if (factor.info() != Eigen::Success) continue;
    const MatrixXd follows = factor.solve(by_parameter);
    for (const Linearised& o : of_point)
      pulls.col(o.image) += o.weight * (o.d_parameters - o.d_point * follows).transpose() * o.error;
  }
  return pulls;
}

BundleInformation::MatrixXd BundleInformation::ClusteredCovariance(const MatrixXd& pulls) const {
  const VectorXd mean = pulls.rowwise().mean();
  const MatrixXd moved = covariance_ * (pulls.colwise() - mean);
  const auto n = static_cast<double>(pulls.cols());
  return n / std::max(1.0, n - 1.0) * moved * moved.transpose();
}

BundleInformation::VectorXd BundleInformation::ParameterStep(const MatrixXd& pulls) const {
  return -covariance_ * pulls.rowwise().sum();
}

}  // namespace rsfm

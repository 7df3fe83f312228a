#include "tests/support/ceres_costs.h"

#include <algorithm>
#include <atomic>

#include "rsfm/estimation/reprojection_residual.h"

namespace rsfm {
namespace {

template <int kRows, int kCols>
using RowMajor =
    Eigen::Matrix<double, kRows, kCols, kCols == 1 ? Eigen::ColMajor : Eigen::RowMajor>;

template <class Matrix, class Expression>
void Write(double* memory, const Expression& value) {
  Eigen::Map<Matrix> map(memory);
  map = value;
}

std::optional<AnyCamera> MakeCamera(const CameraConfig& config) {
  const Expected<AnyCamera> made = AnyCamera::Create(config);
  return made ? std::optional<AnyCamera>(*made) : std::nullopt;
}

}  // namespace

PoseBlock ToBlock(const Rigid3& pose) {
  const Quat& q = pose.rotation;
  const Vec3& t = pose.translation;
  return {q.x(), q.y(), q.z(), q.w(), t.x(), t.y(), t.z()};
}

Rigid3 FromBlock(const double* block) {
  return {Quat(block[3], block[0], block[1], block[2]), Vec3(block[4], block[5], block[6])};
}

bool PoseManifold::Plus(const double* x, const double* delta, double* x_plus_delta) const {
  const PoseBlock moved = ToBlock(Perturb(FromBlock(x), Eigen::Map<const Vec6>(delta)));
  std::copy(moved.begin(), moved.end(), x_plus_delta);
  return true;
}
bool PoseManifold::PlusJacobian(const double*, double* jacobian) const {
  Eigen::Map<RowMajor<7, 6>> j(jacobian);
  j.setZero();
  j.topRows<6>().setIdentity();
  return true;
}
bool PoseManifold::Minus(const double* y, const double* x, double* y_minus_x) const {
  Eigen::Map<Vec6> difference(y_minus_x);
  difference = LogSe3(FromBlock(y) * FromBlock(x).Inverse());
  return true;
}
bool PoseManifold::MinusJacobian(const double*, double* jacobian) const {
  Eigen::Map<RowMajor<6, 7>> j(jacobian);
  j.setZero();
  j.leftCols<6>().setIdentity();
  return true;
}

PortManifold::PortManifold(PortType type, const RefinePort& refine) {
  normal_ = type == PortType::kFlat && refine.normal;
  if (type == PortType::kFlat && refine.distance) free_.push_back(3);
  for (int i = 0; i < 3; ++i)
    if (type == PortType::kDome && refine.center) free_.push_back(i);
  if (refine.index_water) free_.push_back(7);
  tangent_size_ = (normal_ ? 2 : 0) + static_cast<int>(free_.size());
}
bool PortManifold::Plus(const double* x, const double* delta, double* x_plus_delta) const {
  std::copy(x, x + kNumPortParams, x_plus_delta);
  int i = 0;
  if (normal_) {
    const Vec3 n = Eigen::Map<const Vec3>(x).normalized();
    Eigen::Map<Vec3> moved(x_plus_delta);
    moved = (n + TangentBasis(n) * Eigen::Map<const Vec2>(delta)).normalized();
    i = 2;
  }
  for (const int parameter : free_) x_plus_delta[parameter] += delta[i++];
  return true;
}
bool PortManifold::PlusJacobian(const double* x, double* jacobian) const {
  Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>> j(
      jacobian, kNumPortParams, tangent_size_);
  j.setZero();
  int i = 0;
  if (normal_) {
    j.topLeftCorner<3, 2>() = TangentBasis(Eigen::Map<const Vec3>(x).normalized());
    i = 2;
  }
  for (const int parameter : free_) j(parameter, i++) = 1.0;
  return true;
}
bool PortManifold::Minus(const double* y, const double* x, double* y_minus_x) const {
  int i = 0;
  if (normal_) {
    const Vec3 n = Eigen::Map<const Vec3>(x).normalized();
    const Vec3 moved = Eigen::Map<const Vec3>(y).normalized();
    if (!(n.dot(moved) > 0.0)) return false;
    Eigen::Map<Vec2> difference(y_minus_x);
    difference = TangentBasis(n).transpose() * moved / n.dot(moved);
    i = 2;
  }
  for (const int parameter : free_) y_minus_x[i++] = y[parameter] - x[parameter];
  return true;
}
bool PortManifold::MinusJacobian(const double* x, double* jacobian) const {
  Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>> j(
      jacobian, tangent_size_, kNumPortParams);
  j.setZero();
  int i = 0;
  if (normal_) {
    j.topLeftCorner<2, 3>() = TangentBasis(Eigen::Map<const Vec3>(x).normalized()).transpose();
    i = 2;
  }
  for (const int parameter : free_) j(i++, parameter) = 1.0;
  return true;
}

CameraState::CameraState(const CameraConfig& start) : config(start) {
  static std::atomic<std::uint64_t> last_id{0};
  id = ++last_id;
  std::copy(start.lens_params.begin(), start.lens_params.end(), lens.begin());
  port = start.port.Params();
  Update();
}

void CameraState::Update() {
  std::copy_n(lens.begin(), config.lens_params.size(), config.lens_params.begin());
  config.port.SetParams(port);
  camera = MakeCamera(config);
}

const AnyCamera* CameraState::At(const double* lens_params, const double* port_params) const {
  struct Made {
    std::uint64_t id = 0;
    std::array<double, kMaxLensParams> lens{};
    PortParams port{};
    std::optional<AnyCamera> camera;
  };
  thread_local std::array<Made, 4> recent;
  Made& made = recent[id % recent.size()];
  const std::size_t count = config.lens_params.size();
  if (made.id != id || !std::equal(lens_params, lens_params + count, made.lens.begin()) ||
      !std::equal(made.port.begin(), made.port.end(), port_params)) {
    CameraConfig tried = config;
    made.id = id;
    std::copy_n(lens_params, count, made.lens.begin());
    std::copy_n(port_params, made.port.size(), made.port.begin());
    std::copy_n(lens_params, count, tried.lens_params.begin());
    tried.port.SetParams(made.port);
    made.camera = MakeCamera(tried);
  }
  return made.camera ? &*made.camera : nullptr;
}

ReprojectionCost::ReprojectionCost(const CameraState* camera, const Vec2& pixel, double sigma_px,
                                   bool refine_camera)
    : camera_(camera),
      pixel_(pixel),
      inverse_sigma_(1.0 / sigma_px),
      refine_camera_(refine_camera) {
  set_num_residuals(2);
  std::vector<std::int32_t> sizes = {kPoseBlock, 3, NumLensParams(camera->config.lens),
                                     kNumPortParams};
  if (!refine_camera) sizes.resize(2);
  *mutable_parameter_block_sizes() = sizes;
}

bool ReprojectionCost::EvaluateCalibrated(const AnyCamera& camera, double const* const* parameters,
                                          double* residuals, double** jacobians) const {
  const Rigid3 pose = FromBlock(parameters[0]);
  const Eigen::Map<const Vec3> point(parameters[1]);
  Vec2 error(kImpossibleErrorPx, 0.0);
  Mat26 d_pose = Mat26::Zero();
  Mat23 d_point = Mat23::Zero();
  if (jacobians == nullptr) {
    ReprojectionError(camera, pose, point, pixel_, &error);
  } else {
    ReprojectionError(camera, pose, point, pixel_, &error, &d_pose, &d_point);
  }
  Write<Vec2>(residuals, inverse_sigma_ * error);
  if (jacobians == nullptr) return true;
  if (jacobians[0] != nullptr) {
    Eigen::Map<RowMajor<2, 7>> j(jacobians[0]);
    j.leftCols<6>() = inverse_sigma_ * d_pose;
    j.col(6).setZero();
  }
  if (jacobians[1] != nullptr) Write<RowMajor<2, 3>>(jacobians[1], inverse_sigma_ * d_point);
  return true;
}

bool ReprojectionCost::Evaluate(double const* const* parameters, double* residuals,
                                double** jacobians) const {
  const AnyCamera* camera = refine_camera_    ? camera_->At(parameters[2], parameters[3])
                            : camera_->camera ? &*camera_->camera
                                              : nullptr;
  if (camera == nullptr) return false;  // impossible lens or port: Ceres takes a shorter step
  if (!refine_camera_ || jacobians == nullptr ||
      (jacobians[2] == nullptr && jacobians[3] == nullptr))
    return EvaluateCalibrated(*camera, parameters, residuals, jacobians);
  Vec2 error(kImpossibleErrorPx, 0.0);
  ReprojectionJacobian j;
  if (ReprojectionError(*camera, FromBlock(parameters[0]), Eigen::Map<const Vec3>(parameters[1]),
                        pixel_, &error, &j) != Projection::kOk) {
    j.d_error_d_pose.setZero();
    j.d_error_d_point.setZero();
    j.d_error_d_lens.setZero();
    j.d_error_d_port.setZero();
  }
  Write<Vec2>(residuals, inverse_sigma_ * error);
  if (jacobians[0] != nullptr) {
    Eigen::Map<RowMajor<2, 7>> d(jacobians[0]);
    d.leftCols<6>() = inverse_sigma_ * j.d_error_d_pose;
    d.col(6).setZero();
  }
  if (jacobians[1] != nullptr)
    Write<RowMajor<2, 3>>(jacobians[1], inverse_sigma_ * j.d_error_d_point);
  if (jacobians[2] != nullptr) {
    const int count = parameter_block_sizes()[2];
    for (int row = 0; row < 2; ++row)
      for (int i = 0; i < count; ++i)
        jacobians[2][row * count + i] = inverse_sigma_ * j.d_error_d_lens(row, i);
  }
  if (jacobians[3] != nullptr)
    Write<RowMajor<2, kNumPortParams>>(jacobians[3], inverse_sigma_ * j.d_error_d_port);
  return true;
}

PriorCost::PriorCost(const PosePrior& prior) : prior_(prior) {
  set_num_residuals(prior.Dimension());
  mutable_parameter_block_sizes()->push_back(kPoseBlock);
  if (prior.IsRelative()) mutable_parameter_block_sizes()->push_back(kPoseBlock);
}

bool PriorCost::Evaluate(double const* const* parameters, double* residuals,
                         double** jacobians) const {
  const Rigid3 a = FromBlock(parameters[0]);
  const Rigid3 b = prior_.IsRelative() ? FromBlock(parameters[1]) : a;
  const PriorEvaluation e = EvaluatePrior(prior_, a, b);
  for (int row = 0; row < e.dimension; ++row) residuals[row] = e.residual[row];
  if (jacobians == nullptr) return true;
  for (int block = 0; block < (prior_.IsRelative() ? 2 : 1); ++block) {
    if (jacobians[block] == nullptr) continue;
    const Mat6& d = block == 0 ? e.d_residual_d_a : e.d_residual_d_b;
    for (int row = 0; row < e.dimension; ++row) {
      for (int i = 0; i < 6; ++i) jacobians[block][row * kPoseBlock + i] = d(row, i);
      jacobians[block][row * kPoseBlock + 6] = 0.0;
    }
  }
  return true;
}

ParameterPriorCost::ParameterPriorCost(std::vector<double> start, std::vector<double> sigma,
                                       int ratio)
    : start_(std::move(start)), sigma_(std::move(sigma)), ratio_(ratio) {
  set_num_residuals(static_cast<int>(start_.size()));
  mutable_parameter_block_sizes()->push_back(static_cast<int>(start_.size()));
}

bool ParameterPriorCost::Evaluate(double const* const* parameters, double* residuals,
                                  double** jacobians) const {
  const std::size_t count = start_.size();
  for (std::size_t i = 0; i < count; ++i)
    residuals[i] = sigma_[i] > 0.0 ? (parameters[0][i] - start_[i]) / sigma_[i] : 0.0;
  if (ratio_ >= 0 && sigma_[ratio_] > 0.0) {
    if (!(parameters[0][ratio_] > 0.0)) return false;
    residuals[ratio_] =
        start_[ratio_] / sigma_[ratio_] * std::log(parameters[0][ratio_] / start_[ratio_]);
  }
  if (jacobians == nullptr || jacobians[0] == nullptr) return true;
  std::fill(jacobians[0], jacobians[0] + count * count, 0.0);
  for (std::size_t i = 0; i < count; ++i)
    if (sigma_[i] > 0.0) jacobians[0][i * count + i] = 1.0 / sigma_[i];
  if (ratio_ >= 0 && sigma_[ratio_] > 0.0)
    jacobians[0][ratio_ * (count + 1)] *= start_[ratio_] / parameters[0][ratio_];
  return true;
}

ceres::LossFunction* MakeLoss(const RobustLoss& loss) {
  switch (loss.type) {
    case LossType::kHuber:
      return new ceres::HuberLoss(loss.scale);
    case LossType::kCauchy:
      return new ceres::CauchyLoss(loss.scale);
    case LossType::kNone:
      break;
  }
  return nullptr;
}

}  // namespace rsfm

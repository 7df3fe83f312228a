#include "tools/offline/camera_unknowns.h"

#include <algorithm>
#include <cmath>

namespace rsfm {

bool RaysTellScale(PortType type, const BundleOptions& options) {
  return type != PortType::kNone && !options.lens.Any() && !options.port.index_water;
}

bool RefinesPort(PortType type, const RefinePort& refine) {
  switch (type) {
    case PortType::kFlat:
      return refine.normal || refine.distance || refine.index_water;
    case PortType::kDome:
      return refine.center || refine.index_water;
    case PortType::kNone:
      break;
  }
  return false;
}

std::vector<int> HeldLensParams(LensModel lens, const RefineLens& refine) {
  const int num_focal = NumFocalLengths(lens);
  std::vector<int> held;
  for (int i = 0; i < NumLensParams(lens); ++i) {
    const bool refined = i < num_focal       ? refine.focal
                         : i < num_focal + 2 ? refine.principal_point
                                             : refine.distortion;
    if (!refined) held.push_back(i);
  }
  return held;
}

std::vector<double> LensSigmas(const CameraConfig& config, const RefineLens& refine) {
  const int num_focal = NumFocalLengths(config.lens);
  std::vector<double> sigma(config.lens_params.size(), 0.0);
  for (int i = 0; i < static_cast<int>(sigma.size()); ++i) {
    if (i < num_focal) {
      sigma[i] = refine.focal ? refine.sigma_focal * config.lens_params[i] : 0.0;
    } else if (i < num_focal + 2) {
      sigma[i] = refine.principal_point ? refine.sigma_principal_point * config.width : 0.0;
    } else {
      sigma[i] = refine.distortion ? refine.sigma_distortion : 0.0;
    }
  }
  return sigma;
}

namespace {

// What is expected of a camera that is said to touch its window; and where "as near as that" ends.
constexpr double kTouchesM = 1e-3, kLeastDistanceM = 1e-6;

// A dome's third parameter is never refined.
bool IsDistance(const CameraUnknowns::Prior& prior) {
  return prior.is_port && prior.parameter == kPortDistance;
}

}  // namespace

std::vector<double> PortSigmas(const CameraConfig& config, const RefinePort& refine) {
  std::vector<double> sigma(kNumPortParams, 0.0);
  const PortConfig& port = config.port;
  if (port.type == PortType::kFlat) {
    if (refine.normal) std::fill_n(sigma.begin(), 3, refine.sigma_normal_rad);
    if (refine.distance)
      sigma[kPortDistance] = refine.sigma_distance * std::max(port.distance_m, kLeastDistanceM);
  } else if (port.type == PortType::kDome && refine.center) {
    std::fill_n(sigma.begin(), 3, refine.sigma_center_m);
  }
  if (port.type != PortType::kNone && refine.index_water)
    sigma[kPortIndexWater] = refine.sigma_index;
  return sigma;
}

CameraUnknowns::CameraUnknowns(const BundleOptions& options,
                               const std::vector<CameraConfig>& expected) {
  for (int c = 0; c < static_cast<int>(expected.size()); ++c) {
    const CameraConfig& config = expected[c];
    Camera camera;
    camera.first = count_;
    const std::vector<double> lens_sigma = LensSigmas(config, options.lens);
    const std::vector<int> held = HeldLensParams(config.lens, options.lens);
    for (int i = 0; i < NumLensParams(config.lens); ++i) {
      if (std::find(held.begin(), held.end(), i) != held.end()) continue;
      camera.lens.push_back(i);
      if (lens_sigma[i] > 0.0)
        priors_.push_back({c, false, i, config.lens_params[i], lens_sigma[i]});
    }
    if (RefinesPort(config.port.type, options.port)) {
      const PortType type = config.port.type;
      camera.normal = type == PortType::kFlat && options.port.normal;
      if (type == PortType::kFlat && options.port.distance) camera.port.push_back(kPortDistance);
      if (type == PortType::kDome && options.port.center) camera.port = {0, 1, 2};
      if (options.port.index_water) camera.port.push_back(kPortIndexWater);
      const std::vector<double> port_sigma = PortSigmas(config, options.port);
      const PortParams params = config.port.Params();
      for (int i = 0; i < kNumPortParams; ++i) {
        if (!(port_sigma[i] > 0.0)) continue;
        priors_.push_back({c, true, i, params[i], port_sigma[i]});
        if (Prior& prior = priors_.back(); IsDistance(prior)) {
          prior.expected = std::max(prior.expected, kTouchesM);
          prior.sigma = options.port.sigma_distance;
        }
      }
    }
    camera.count =
        static_cast<int>(camera.lens.size() + camera.port.size()) + (camera.normal ? 2 : 0);
    count_ += camera.count;
    cameras_.push_back(std::move(camera));
  }
}

Eigen::Matrix<double, kNumPortParams, Eigen::Dynamic> CameraUnknowns::PortColumns(
    int camera, const CameraConfig& config) const {
  const Camera& c = cameras_[camera];
  Eigen::Matrix<double, kNumPortParams, Eigen::Dynamic> columns(
      kNumPortParams, c.count - static_cast<int>(c.lens.size()));
  columns.setZero();
  int column = 0;
  if (c.normal) {
    columns.topLeftCorner<3, 2>() = TangentBasis(config.port.normal.normalized());
    column = 2;
  }
  for (const int parameter : c.port) columns(parameter, column++) = 1.0;
  return columns;
}

void CameraUnknowns::Columns(
    int camera, const ReprojectionJacobian& jacobian,
    const Eigen::Matrix<double, kNumPortParams, Eigen::Dynamic>& port_columns,
    CameraColumnsJacobian* columns) const {
  const Camera& c = cameras_[camera];
  columns->resize(2, c.count);
  int column = 0;
  for (const int parameter : c.lens)
    columns->col(column++) = jacobian.d_error_d_lens.col(parameter);
  if (c.normal) {
    columns->middleCols<2>(column).noalias() =
        jacobian.d_error_d_port.leftCols<3>().lazyProduct(port_columns.topLeftCorner<3, 2>());
    column += 2;
  }
  for (const int parameter : c.port)
    columns->col(column++) = jacobian.d_error_d_port.col(parameter);
}

bool CameraUnknowns::Plus(const Eigen::VectorXd& delta, const std::vector<CameraConfig>& configs,
                          std::vector<CameraConfig>* moved) const {
  *moved = configs;
  if (!delta.allFinite()) return false;
  for (int index = 0; index < num_cameras(); ++index) {
    const Camera& c = cameras_[index];
    CameraConfig& config = (*moved)[index];
    int column = c.first;
    for (const int parameter : c.lens) {
      double& value = config.lens_params[parameter];
      const double before = value;
      value += delta[column++];
      if (parameter < NumFocalLengths(config.lens))
        value = std::clamp(value, 0.5 * before, 2.0 * before);
    }
    if (c.normal) {
      const Vec3 n = config.port.normal.normalized();
      config.port.normal = (n + TangentBasis(n) * delta.segment<2>(column)).normalized();
      column += 2;
    }
    PortParams port = config.port.Params();
    for (const int parameter : c.port) {
      const double before = port[parameter];
      port[parameter] += delta[column++];
      if (config.port.type == PortType::kFlat && parameter == kPortDistance)
        port[parameter] = std::max(port[parameter], 0.1 * before);
      if (parameter == kPortIndexWater) port[parameter] = std::clamp(port[parameter], 1.0, 2.0);
    }
    config.port.SetParams(port);
    if (!AnyCamera::Create(config)) return false;
  }
  return true;
}

double CameraUnknowns::Residual(const Prior& prior,
                                const std::vector<CameraConfig>& configs) const {
  const CameraConfig& config = configs[prior.camera];
  const double value =
      prior.is_port ? config.port.Params()[prior.parameter] : config.lens_params[prior.parameter];
  return IsDistance(prior)
             ? std::log(std::max(value, kLeastDistanceM) / prior.expected) / prior.sigma
             : (value - prior.expected) / prior.sigma;
}

double CameraUnknowns::Slope(const Prior& prior, const std::vector<CameraConfig>& configs) const {
  const double now = configs[prior.camera].port.distance_m;
  return 1.0 / (IsDistance(prior) ? prior.sigma * std::max(now, kLeastDistanceM) : prior.sigma);
}

double CameraUnknowns::PriorCost(const std::vector<CameraConfig>& configs) const {
  double cost = 0.0;
  for (const Prior& prior : priors_) cost += 0.5 * std::pow(Residual(prior, configs), 2);
  return cost;
}

void CameraUnknowns::AddPriors(const std::vector<CameraConfig>& configs,
                               Eigen::MatrixXd* information, Eigen::VectorXd* gradient) const {
  for (const Prior& prior : priors_) {
    const Camera& c = cameras_[prior.camera];
    const int num_lens = static_cast<int>(c.lens.size());
    const double slope = Slope(prior, configs);
    Eigen::RowVectorXd d = Eigen::RowVectorXd::Zero(c.count);
    if (prior.is_port) {
      d.tail(c.count - num_lens) =
          PortColumns(prior.camera, configs[prior.camera]).row(prior.parameter) * slope;
    } else {
      const auto place = std::find(c.lens.begin(), c.lens.end(), prior.parameter);
      d[place - c.lens.begin()] = slope;
    }
    information->block(c.first, c.first, c.count, c.count) += d.transpose() * d;
    gradient->segment(c.first, c.count) += Residual(prior, configs) * d.transpose();
  }
}

}  // namespace rsfm

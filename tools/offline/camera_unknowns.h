// The parameters of lenses and ports that a bundle adjustment refines: the few columns that all
// observations share. Each camera has its free lens parameters first, then its port's; a flat
// port's normal moves on the sphere and has two columns.
#pragma once

#include <Eigen/Dense>
#include <vector>

#include "rsfm/estimation/ray_pair.h"
#include "rsfm/estimation/reprojection_residual.h"
#include "tools/offline/bundle.h"

namespace rsfm {

// Places in PortParams.
inline constexpr int kPortDistance = 3, kPortIndexWater = 7;

inline constexpr int kMaxCameraColumns = kMaxLensParams + kNumPortParams;
using CameraColumnsJacobian =
    Eigen::Matrix<double, 2, Eigen::Dynamic, Eigen::ColMajor, 2, kMaxCameraColumns>;

class CameraUnknowns {
 public:
  struct Camera {
    int first = 0;          // column
    int count = 0;          // columns
    std::vector<int> lens;  // the free lens parameters
    bool normal = false;    // two columns after those of the lens
    std::vector<int> port;  // the other free port parameters
  };
  // One Gaussian prior on one parameter: (x - expected) / sigma; on a flat port's distance, which
  // is never negative, on its logarithm: ln(x / expected) / sigma.
  struct Prior {
    int camera = 0;
    bool is_port = false;
    int parameter = 0;
    double expected = 0.0, sigma = 0.0;
  };

  // `expected` is where the priors pull to.
  CameraUnknowns(const BundleOptions& options, const std::vector<CameraConfig>& expected);

  int count() const { return count_; }
  const Camera& camera(int index) const { return cameras_[index]; }
  int num_cameras() const { return static_cast<int>(cameras_.size()); }

  // Derivatives of the port's parameters by its columns, at `config`.
  Eigen::Matrix<double, kNumPortParams, Eigen::Dynamic> PortColumns(
      int camera, const CameraConfig& config) const;
  // The columns of `camera` out of all derivatives; `port_columns` as above.
  void Columns(int camera, const ReprojectionJacobian& jacobian,
               const Eigen::Matrix<double, kNumPortParams, Eigen::Dynamic>& port_columns,
               CameraColumnsJacobian* columns) const;

  // Moves the cameras by `delta`, count() long. Parameters stay within what is possible at all: a
  // positive focal length, port distance and index; nothing when the result is no camera.
  bool Plus(const Eigen::VectorXd& delta, const std::vector<CameraConfig>& configs,
            std::vector<CameraConfig>* moved) const;

  double PriorCost(const std::vector<CameraConfig>& configs) const;
  // Adds the priors' normal equations.
  void AddPriors(const std::vector<CameraConfig>& configs, Eigen::MatrixXd* information,
                 Eigen::VectorXd* gradient) const;

 private:
  double Residual(const Prior& prior, const std::vector<CameraConfig>& configs) const;
  double Slope(const Prior& prior, const std::vector<CameraConfig>& configs) const;

  std::vector<Camera> cameras_;
  std::vector<Prior> priors_;
  int count_ = 0;
};

// Indices of the lens parameters that stay.
std::vector<int> HeldLensParams(LensModel lens, const RefineLens& refine);
// The sigmas of the refined parameters' priors near `config`, 0 for those that are not.
std::vector<double> LensSigmas(const CameraConfig& config, const RefineLens& refine);
std::vector<double> PortSigmas(const CameraConfig& config, const RefinePort& refine);

}  // namespace rsfm

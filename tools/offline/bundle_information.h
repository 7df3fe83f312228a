// What a bundle adjustment knows at its solution: the Schur complement on the poses and the refined
// parameters of lens and port, for standard deviations of whatever depends on them.
#pragma once

#include <Eigen/Dense>
#include <array>
#include <cstdint>
#include <memory>
#include <unordered_map>
#include <vector>

#include "rsfm/estimation/reprojection_residual.h"
#include "tools/offline/observability.h"

namespace rsfm {

class BundleInformation {
 public:
  using MatrixXd = Eigen::MatrixXd;
  using VectorXd = Eigen::VectorXd;

  // `start` has the cameras as they were before. All three must outlive this.
  BundleInformation(const BundleOptions& options, const std::vector<CameraConfig>& start,
                    const BundleProblem& problem);

  int num_parameters() const { return static_cast<int>(estimates_.size()); }
  double noise_px() const { return noise_px_; }
  const std::vector<ParameterEstimate>& estimates() const { return estimates_; }

  void AddPriors(const std::vector<PosePrior>& priors);

  // Factorises what there is. False when the poses or the parameters are not determined.
  bool Factorise();

  // After Factorise.
  const MatrixXd& covariance() const { return covariance_; }  // of the parameters
  // Of a function of the poses with this gradient, and its correlation with each parameter.
  double Variance(const VectorXd& gradient, VectorXd* correlation = nullptr) const;
  // Column by column each image's share of the gradient by the parameters, poses and points having
  // followed: what the next two are made from.
  MatrixXd PullsOfImages() const;
  // The covariance that the residuals themselves show when those of an image may go together in any
  // way, as they do where the camera model is not the whole truth.
  //   [Liang & Zeger 1986, Biometrika 73(1), sec. 2]
  MatrixXd ClusteredCovariance(const MatrixXd& pulls) const;
  // The step that the residuals ask of the parameters, all else following; near 0 where they have
  // been adjusted.
  VectorXd ParameterStep(const MatrixXd& pulls) const;

  // Gradients for Variance: d log(distance of the pair) / d (poses), and that of a sum of
  // weights[i] . (place of image i).
  VectorXd ScaleGradient(const std::array<int, 2>& pair) const;
  VectorXd PlacesGradient(const std::vector<Vec3>& weights) const;

 private:
  // The refined parameters of one camera: columns of the derivatives by lens and port parameters.
  struct CameraColumns {
    int first = 0;            // in the vector of all refined parameters
    MatrixXd lens_to_column;  // lens parameters x count
    MatrixXd port_to_column;  // port parameters x count
    int count = 0;
  };
  struct Linearised {
    int image = 0, block = -1;
    double weight = 0.0;  // of the squared error, 1 / px^2
    Vec2 error;
    Mat26 d_pose;
    Mat23 d_point;
    MatrixXd d_parameters;  // all of them
  };

  void AddCamera(std::size_t index, const CameraConfig& start);
  void AddBlock(int row, int column, const Mat6& block);
  void EstimateNoise();
  bool Linearise(int index, Linearised* result) const;
  std::vector<std::vector<int>> OfPoints() const;
  void EliminatePoint(const std::vector<int>& observations);

  const BundleOptions& options_;
  const BundleProblem& problem_;
  std::vector<AnyCamera> cameras_;
  std::vector<CameraColumns> columns_;
  std::vector<ParameterEstimate> estimates_;
  std::vector<int> pose_block_;
  int num_poses_ = 0;
  double noise_px_ = 1.0;
  std::unordered_map<std::uint64_t, Mat6> blocks_;  // lower triangle
  MatrixXd pose_by_parameter_, parameters_by_parameters_;
  struct Factor;
  std::shared_ptr<const Factor> factor_;  // of the poses
  MatrixXd poses_through_parameters_;     // inverse of the poses' information * pose_by_parameter_
  MatrixXd covariance_;
};

}  // namespace rsfm

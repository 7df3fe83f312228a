#include "tools/evaluation/alignment.h"

#include <Eigen/Eigenvalues>
#include <Eigen/SVD>
#include <cmath>
#include <vector>

namespace rsfm {
namespace {

// Positions whose second principal extent is below this part of the first are a line.
constexpr double kLineRatio = 1e-3;

struct Moments {
  Vec3 mean_from = Vec3::Zero(), mean_to = Vec3::Zero();
  Mat3 covariance = Mat3::Zero();  // of to with from, eq. (38)
  double variance_from = 0.0;
};

Moments ComputeMoments(std::span<const Vec3> from, std::span<const Vec3> to) {
  Moments m;
  const auto n = static_cast<double>(from.size());
  for (std::size_t i = 0; i < from.size(); ++i) {
    m.mean_from += from[i] / n;
    m.mean_to += to[i] / n;
  }
  for (std::size_t i = 0; i < from.size(); ++i) {
    const Vec3 f = from[i] - m.mean_from;
    m.covariance += (to[i] - m.mean_to) * f.transpose() / n;
    m.variance_from += f.squaredNorm() / n;
  }
  return m;
}

// Scale and translation for a given rotation: the other two parts of the least-squares solution.
Similarity Complete(const Moments& m, const Quat& rotation, Alignment alignment) {
  Similarity s;
  if (alignment == Alignment::kSim3) {
    s.scale = (rotation.toRotationMatrix().transpose() * m.covariance).trace() / m.variance_from;
  }
  s.transform.rotation = rotation;
  s.transform.translation = m.mean_to - s.scale * (rotation * m.mean_from);
  return s;
}

}  // namespace

std::optional<Alignment> AlignmentNamed(std::string_view name) {
  if (name == "none") return Alignment::kNone;
  if (name == "yaw") return Alignment::kYaw;
  if (name == "se3") return Alignment::kSe3;
  if (name == "sim3") return Alignment::kSim3;
  return std::nullopt;
}

const char* Describe(Alignment alignment) {
  switch (alignment) {
    case Alignment::kNone:
      return "none: as it is";
    case Alignment::kYaw:
      return "heading and translation";
    case Alignment::kSe3:
      return "rotation and translation";
    case Alignment::kSim3:
      break;
  }
  return "rotation, translation and scale";
}

Expected<Similarity> AlignPoints(std::span<const Vec3> from, std::span<const Vec3> to,
                                 Alignment alignment) {
  if (alignment == Alignment::kNone) return Similarity();
  if (from.size() != to.size()) return Fail(Errc::kInvalidArgument, "from, to");
  if (from.size() < 3) return Fail(Errc::kNotEnoughData, "positions");
  const Moments m = ComputeMoments(from, to);
  if (alignment == Alignment::kYaw) {
    const double sine = m.covariance(1, 0) - m.covariance(0, 1);
    const double cosine = m.covariance(0, 0) + m.covariance(1, 1);
    if (!(std::hypot(sine, cosine) > 0.0)) return Fail(Errc::kDegenerate, "positions");
    return Complete(m, Quat(Eigen::AngleAxisd(std::atan2(sine, cosine), Vec3::UnitZ())), alignment);
  }
  const Eigen::JacobiSVD<Mat3> svd(m.covariance, Eigen::ComputeFullU | Eigen::ComputeFullV);
  const Vec3 d = svd.singularValues();
  if (!(d[0] > 0.0) || d[1] < kLineRatio * kLineRatio * d[0]) {
    return Fail(Errc::kDegenerate, "positions");
  }
  Mat3 sign = Mat3::Identity();  // eq. (39): a rotation, never a reflection
  if (svd.matrixU().determinant() * svd.matrixV().determinant() < 0.0) sign(2, 2) = -1.0;
  const Mat3 rotation = svd.matrixU() * sign * svd.matrixV().transpose();  // eq. (40)
  return Complete(m, Quat(rotation).normalized(), alignment);
}

Expected<Similarity> AlignPoses(std::span<const Rigid3> from, std::span<const Rigid3> to,
                                Alignment alignment) {
  if (alignment == Alignment::kNone) return Similarity();
  if (from.size() != to.size()) return Fail(Errc::kInvalidArgument, "from, to");
  if (from.empty()) return Fail(Errc::kNotEnoughData, "poses");
  std::vector<Vec3> from_positions, to_positions;
  for (std::size_t i = 0; i < from.size(); ++i) {
    from_positions.push_back(from[i].translation);
    to_positions.push_back(to[i].translation);
  }
  const auto aligned = AlignPoints(from_positions, to_positions, alignment);
  if (aligned || alignment == Alignment::kYaw) return aligned;
  // The chordal mean of to * from^-1: the eigenvector of sum q q^T of the largest eigenvalue.
  //   [Markley 2007, J. Guidance, Control and Dynamics 30(4), eqs. (12)-(13)]
  Mat4 sum = Mat4::Zero();
  for (std::size_t i = 0; i < from.size(); ++i) {
    const Vec4 q = (to[i].rotation * from[i].rotation.conjugate()).coeffs();
    sum += q * q.transpose();
  }
  const Eigen::SelfAdjointEigenSolver<Mat4> solver(sum);
  const Quat rotation(Vec4(solver.eigenvectors().col(3)));
  const Moments m = ComputeMoments(from_positions, to_positions);
  if (alignment == Alignment::kSim3 && !(m.variance_from > 0.0)) {
    return Fail(Errc::kDegenerate, "positions");
  }
  return Complete(m, rotation.normalized(), alignment);
}

}  // namespace rsfm

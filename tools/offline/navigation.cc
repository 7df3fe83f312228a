#include "tools/offline/navigation.h"

#include <Eigen/Dense>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

#include "rsfm/navigation/nav_buffer.h"

namespace rsfm {
namespace {

constexpr double kRadPerDeg = std::numbers::pi / 180.0;

// Navigation at the times of the placed images.
class NavigationAtImages {
 public:
  NavigationAtImages(const NavigationInput& input, const Scene& scene)
      : input_(input), buffer_(MakeBuffer(input)) {
    const MapperOptions& d = input.defaults;
    defaults_.sigma_position_m = Vec3::Constant(d.position_sigma_m);
    defaults_.sigma_attitude_rad = Vec3::Constant(d.attitude_sigma_deg * kRadPerDeg);
    defaults_.sigma_velocity_mps = Vec3::Constant(d.velocity_sigma_mps);
    defaults_.sigma_depth_m = d.depth_sigma_m;
    for (std::size_t i = 0; i < scene.images.size(); ++i)
      if (scene.images[i].placed && scene.images[i].utime > 0)
        order_.push_back(static_cast<int>(i));
    std::stable_sort(order_.begin(), order_.end(), [&scene](int a, int b) {
      return scene.images[a].utime < scene.images[b].utime;
    });
    for (const int i : order_) samples_.push_back(At(scene.images[i].utime));
  }

  bool usable() const { return buffer_.has_value() && !order_.empty(); }
  // Placed images in the order of time, and navigation at each.
  const std::vector<int>& order() const { return order_; }
  const NavSample& sample(std::size_t k) const { return samples_[k]; }

  std::optional<NavMotion> Motion(Utime start, Utime end) const {
    if (!buffer_) return std::nullopt;
    const auto motion = buffer_->DeadReckon(start, end, defaults_);
    if (!motion) return std::nullopt;
    return *motion;
  }

 private:
  static std::optional<NavBuffer> MakeBuffer(const NavigationInput& input) {
    NavBufferOptions options;
    options.capacity = static_cast<int>(input.samples.size()) + 1;
    options.max_gap_s = input.defaults.nav_max_gap_s;
    options.max_late_s = 1e9;
    auto buffer = NavBuffer::Create(options);
    if (!buffer) return std::nullopt;
    for (const NavSample& sample : input.samples) buffer->Insert(sample);
    return std::optional<NavBuffer>(std::move(*buffer));
  }

  NavSample At(Utime utime) const {
    NavSample sample = buffer_ ? buffer_->At(utime) : NavSample{};
    if (!(sample.sigma_position_m.array() > 0.0).all())
      sample.sigma_position_m = defaults_.sigma_position_m;
    if (!(sample.sigma_attitude_rad.array() > 0.0).all())
      sample.sigma_attitude_rad = defaults_.sigma_attitude_rad;
    if (!(sample.sigma_depth_m > 0.0)) sample.sigma_depth_m = defaults_.sigma_depth_m;
    return sample;
  }

  const NavigationInput& input_;
  std::optional<NavBuffer> buffer_;
  NavSample defaults_;
  std::vector<int> order_;
  std::vector<NavSample> samples_;
};

void Transform(const Mat3& rotation, const Vec3& translation, double scale, Scene* scene) {
  const Quat q(rotation);
  for (SceneImage& image : scene->images) {
    if (!image.placed) continue;
    const Vec3 place = scale * (rotation * image.camera_from_world.OriginOfTarget()) + translation;
    const Quat turned = (image.camera_from_world.rotation * q.conjugate()).normalized();
    image.camera_from_world = Rigid3(turned, -(turned * place));
  }
  for (ScenePoint& point : scene->points)
    if (!point.track.empty()) point.xyz = scale * (rotation * point.xyz) + translation;
}

// The mean of the rotations that the attitude sensor says.   [Markley 2007, JGCD 30(4), eq. (12)]
std::optional<Mat3> RotationFromAttitude(const NavigationAtImages& nav, const Scene& scene,
                                         const Rigid3& body_from_camera) {
  Mat4 sum = Mat4::Zero();
  for (std::size_t k = 0; k < nav.order().size(); ++k) {
    if (!nav.sample(k).Has(NavField::kAttitude)) continue;
    const Quat q = nav.sample(k).ned_from_body * body_from_camera.rotation *
                   scene.images[nav.order()[k]].camera_from_world.rotation;
    sum += q.coeffs() * q.coeffs().transpose();
  }
  if (sum.isZero(0.0)) return std::nullopt;
  const Eigen::SelfAdjointEigenSolver<Mat4> eigen(sum);
  const Vec4 best = eigen.eigenvectors().col(3);
  return Quat(best).toRotationMatrix();
}

struct PlacePair {
  Vec3 in_scene;
  Vec3 in_ned;
};

// Camera centres in the scene and where navigation has them.
std::vector<PlacePair> Places(const NavigationAtImages& nav, const Scene& scene,
                              const Rigid3& body_from_camera) {
  std::vector<PlacePair> pairs;
  for (std::size_t k = 0; k < nav.order().size(); ++k) {
    const NavSample& s = nav.sample(k);
    if (!s.Has(NavField::kPosition)) continue;
    const Vec3 lever = s.Has(NavField::kAttitude) ? s.ned_from_body * body_from_camera.translation
                                                  : Vec3(Vec3::Zero());
    pairs.push_back({scene.images[nav.order()[k]].camera_from_world.OriginOfTarget(),
                     s.position_ned_m + lever});
  }
  return pairs;
}

struct Means {
  Vec3 in_scene = Vec3::Zero(), in_ned = Vec3::Zero();
};
Means MeanPlaces(const std::vector<PlacePair>& places) {
  Means means;
  for (const PlacePair& p : places) {
    means.in_scene += p.in_scene / static_cast<double>(places.size());
    means.in_ned += p.in_ned / static_cast<double>(places.size());
  }
  return means;
}

// The similarity that fits best; nothing when the places lie on a line.   [Umeyama 1991, PAMI
// 13(4)]
std::optional<Mat3> RotationFromPlaces(const std::vector<PlacePair>& places) {
  if (places.size() < 3) return std::nullopt;
  const Means means = MeanPlaces(places);
  Mat3 covariance = Mat3::Zero();
  for (const PlacePair& p : places)
    covariance += (p.in_ned - means.in_ned) * (p.in_scene - means.in_scene).transpose();
  const Eigen::JacobiSVD<Mat3> svd(covariance, Eigen::ComputeFullU | Eigen::ComputeFullV);
  if (svd.singularValues()[1] < 1e-3 * svd.singularValues()[0]) return std::nullopt;
  Vec3 signs(1.0, 1.0,
             (svd.matrixU() * svd.matrixV().transpose()).determinant() < 0.0 ? -1.0 : 1.0);
  return Mat3(svd.matrixU() * signs.asDiagonal() * svd.matrixV().transpose());
}

// The factor s that makes s * (turned displacements) fit the measured ones.
struct ScaleFit {
  double both = 0.0, own = 0.0, measured = 0.0;
  void Add(const Vec3& turned, const Vec3& in_ned) {
    both += turned.dot(in_ned);
    own += turned.squaredNorm();
    measured += in_ned.squaredNorm();
  }
  // Nothing when they have little in common: the sensor saw no motion, or another.
  std::optional<double> Factor() const {
    if (!(own > 0.0) || !(both > 0.3 * std::sqrt(own * measured))) return std::nullopt;
    return both / own;
  }
};

ScaleFit FitDisplacements(const NavigationAtImages& nav, const Scene& scene, const Mat3& rotation,
                          const Rigid3& body_from_camera) {
  ScaleFit fit;
  for (std::size_t k = 1; k < nav.order().size(); ++k) {
    const SceneImage& a = scene.images[nav.order()[k - 1]];
    const SceneImage& b = scene.images[nav.order()[k]];
    const auto motion = nav.Motion(a.utime, b.utime);
    if (!motion) continue;
    const Vec3& lever = body_from_camera.translation;
    const Vec3 measured = motion->displacement_ned_m + motion->ned_from_body_end * lever -
                          motion->ned_from_body_start * lever;
    fit.Add(
        rotation * (b.camera_from_world.OriginOfTarget() - a.camera_from_world.OriginOfTarget()),
        measured);
  }
  return fit;
}

}  // namespace

NavigationAlignment AlignToNavigation(const NavigationInput& input, Scene* scene) {
  NavigationAlignment result;
  const NavigationAtImages nav(input, *scene);
  if (!nav.usable()) return result;
  const std::vector<PlacePair> places = Places(nav, *scene, input.body_from_camera);
  Mat3 rotation = Mat3::Identity();
  if (const auto from_attitude = RotationFromAttitude(nav, *scene, input.body_from_camera)) {
    rotation = *from_attitude;
    result.attitude = true;
  } else if (const auto from_places = RotationFromPlaces(places)) {
    rotation = *from_places;
    result.attitude = true;
  }
  double scale = 1.0;
  if (result.attitude) {
    const Means means = MeanPlaces(places);
    ScaleFit fit;
    for (const PlacePair& p : places)
      fit.Add(rotation * (p.in_scene - means.in_scene), p.in_ned - means.in_ned);
    std::optional<double> factor = fit.Factor();
    if (!factor) factor = FitDisplacements(nav, *scene, rotation, input.body_from_camera).Factor();
    result.scale = factor.has_value();
    scale = factor.value_or(1.0);
  }
  result.scale_factor = scale;
  Vec3 translation = Vec3::Zero();
  if (!places.empty()) {
    const Means means = MeanPlaces(places);
    translation = means.in_ned - scale * (rotation * means.in_scene);
    result.position = true;
  } else if (result.attitude) {
    double sum = 0.0;
    int count = 0;
    for (std::size_t k = 0; k < nav.order().size(); ++k) {
      if (!nav.sample(k).Has(NavField::kDepth)) continue;
      const Rigid3& pose = scene->images[nav.order()[k]].camera_from_world;
      sum += nav.sample(k).depth_m - scale * (rotation * pose.OriginOfTarget()).z();
      ++count;
    }
    result.depth = count > 0;
    if (count > 0) translation.z() = sum / count;
  }
  Transform(rotation, translation, scale, scene);
  return result;
}

std::vector<PosePrior> NavigationPriors(const NavigationInput& input, const Scene& scene) {
  std::vector<PosePrior> priors;
  const NavigationAtImages nav(input, scene);
  if (!nav.usable()) return priors;
  const RobustLoss robust{LossType::kCauchy, 3.0};
  const auto add = [&priors](const Expected<PosePrior>& prior, const RobustLoss& loss) {
    if (!prior) return;
    priors.push_back(*prior);
    priors.back().loss = loss;
  };
  // Depth is below the surface, the world's vertical below its origin: with positions in the
  // mission the two differ by an offset that nobody states, and positions have the vertical
  // already.
  bool has_position = false;
  for (std::size_t k = 0; k < nav.order().size(); ++k)
    has_position = has_position || nav.sample(k).Has(NavField::kPosition);
  for (std::size_t k = 0; k < nav.order().size(); ++k) {
    const NavSample& s = nav.sample(k);
    const int image = nav.order()[k];
    if (s.Has(NavField::kPosition)) {
      add(MakePositionPrior(image, input.body_from_camera, s.position_ned_m, s.sigma_position_m),
          robust);
    } else if (s.Has(NavField::kDepth) && !has_position) {
      add(MakeDepthPrior(image, input.body_from_camera, s.depth_m, s.sigma_depth_m), robust);
    }
    if (s.Has(NavField::kAttitude))
      add(MakeAttitudePrior(image, input.body_from_camera, s.ned_from_body, s.sigma_attitude_rad),
          {});
    if (k == 0) continue;
    const int before = nav.order()[k - 1];
    const auto motion = nav.Motion(scene.images[before].utime, scene.images[image].utime);
    if (!motion) continue;
    const Vec3 sigma = motion->covariance_m2.diagonal().cwiseMax(1e-8).cwiseSqrt();
    add(MakeDisplacementPrior(before, image, input.body_from_camera,
                              motion->ned_from_body_start.conjugate() * motion->displacement_ned_m,
                              Vec3::Constant(sigma.maxCoeff())),
        robust);
  }
  return priors;
}

}  // namespace rsfm

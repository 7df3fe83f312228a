#include "rsfm/estimation/marginal_prior.h"

#include <algorithm>

namespace rsfm {
namespace {

std::size_t Count(int value) { return static_cast<std::size_t>(std::max(value, 0)); }

constexpr double kPinned = 1e12;  // information of a state that is not to move

}  // namespace

MarginalPrior::MarginalPrior(int max_keyframes)
    : first_estimates(Count(max_keyframes)),
      information(max_keyframes + kNavBlocks),
      gradient(Count(max_keyframes + kNavBlocks)),
      direction_(Count(max_keyframes + kNavBlocks)),
      product_(Count(max_keyframes + kNavBlocks)) {}

void MarginalPrior::Clear() noexcept {
  first_estimates.clear();
  has_states = false;
  first_states.setZero();
  information.Reset(0);
  gradient.clear();
  cost = 0.0;
}

void MarginalPrior::StartWithStates(const NavStates& states, const NavStates& sigmas) noexcept {
  Clear();
  has_states = true;
  first_states = states;
  information.Reset(kNavBlocks);
  gradient.TryResizeForOverwrite(kNavBlocks);
  for (Vec6& block : gradient) block.setZero();
  for (int i = 0; i < kNumNavStates; ++i)
    information.Block(i / 6, i / 6)(i % 6, i % 6) =
        sigmas[i] > 0.0 ? 1.0 / (sigmas[i] * sigmas[i]) : kPinned;
}

void MarginalPrior::AddNoise(const NavStates& variances) noexcept {
  if (!has_states) return;
  direction_.TryResizeForOverwrite(static_cast<std::size_t>(num_blocks()));
  for (int i = 0; i < kNumNavStates; ++i) {
    if (!(variances[i] > 0.0)) continue;
    for (Vec6& block : direction_) block.setZero();
    direction_[static_cast<std::size_t>(num_keyframes() + i / 6)][i % 6] = 1.0;
    AddNoiseAlongDirection(variances[i]);
  }
}

// A world moved by t is a camera moved by -R t in its own axes.
void MarginalPrior::AddTranslationNoise(const Vec3& direction_in_world,
                                        double variance_m2) noexcept {
  direction_.TryResizeForOverwrite(static_cast<std::size_t>(num_blocks()));
  for (Vec6& block : direction_) block.setZero();
  for (std::size_t k = 0; k < first_estimates.size(); ++k)
    direction_[k].tail<3>() = -(first_estimates[k].rotation * direction_in_world);
  AddNoiseAlongDirection(variance_m2);
}

void MarginalPrior::Translate(const Vec3& by_m) noexcept {
  for (Rigid3& pose : first_estimates) pose.translation -= pose.rotation * by_m;
}

// d' = d + n w, w ~ N(0, q), with d marginalised out: the information form of P + q n n',
//   H' = H - s (H n)(H n)',  g' = g - s (H n)(n' g),  s = q / (1 + q n' H n),
// by Sherman and Morrison; the minimum and its cost stay.
void MarginalPrior::AddNoiseAlongDirection(double variance) noexcept {
  const int size = num_blocks();
  product_.TryResizeForOverwrite(static_cast<std::size_t>(size));
  double curvature = 0.0, slope = 0.0;
  for (int i = 0; i < size; ++i) {
    Vec6& product = product_[static_cast<std::size_t>(i)];
    product.setZero();
    for (int j = 0; j < size; ++j) {
      const Vec6& direction = direction_[static_cast<std::size_t>(j)];
      if (j <= i) {
        product.noalias() += information.Block(i, j) * direction;
      } else {
        product.noalias() += information.Block(j, i).transpose() * direction;
      }
    }
    curvature += direction_[static_cast<std::size_t>(i)].dot(product);
    slope += direction_[static_cast<std::size_t>(i)].dot(gradient[static_cast<std::size_t>(i)]);
  }
  const double s = variance / (1.0 + variance * curvature);
  for (int i = 0; i < size; ++i) {
    const Vec6& row = product_[static_cast<std::size_t>(i)];
    gradient[static_cast<std::size_t>(i)] -= s * slope * row;
    for (int j = 0; j <= i; ++j)
      information.Block(i, j).noalias() -=
          s * row * product_[static_cast<std::size_t>(j)].transpose();
  }
  cost -= 0.5 * s * slope * slope;
}

void MarginalPrior::Rebase(int keyframe, const Rigid3& camera_from_world) noexcept {
  const auto k = static_cast<std::size_t>(keyframe);
  const Vec6 moved = PoseDifference(camera_from_world, first_estimates[k], nullptr);
  first_estimates[k] = camera_from_world;
  cost += gradient[k].dot(moved) + 0.5 * moved.dot(information.Block(keyframe, keyframe) * moved);
  for (int i = 0; i < num_blocks(); ++i) {
    const auto row = static_cast<std::size_t>(i);
    if (i >= keyframe) {
      gradient[row].noalias() += information.Block(i, keyframe) * moved;
    } else {
      gradient[row].noalias() += information.Block(keyframe, i).transpose() * moved;
    }
  }
}

// [Barfoot 2017, "State Estimation for Robotics", eq. (7.94): J_l^-1(x) = 1 - ad(x) / 2 + ...]
Vec6 PoseDifference(const Rigid3& b, const Rigid3& a, Mat6* d_difference_d_b) noexcept {
  const Vec6 x = LogSe3(b * a.Inverse());
  if (d_difference_d_b != nullptr) {
    Mat6 ad = Mat6::Zero();
    ad.topLeftCorner<3, 3>() = ad.bottomRightCorner<3, 3>() = Hat(x.head<3>());
    ad.bottomLeftCorner<3, 3>() = Hat(x.tail<3>());
    *d_difference_d_b = Mat6::Identity() - 0.5 * ad + ad * ad / 12.0;
  }
  return x;
}

}  // namespace rsfm

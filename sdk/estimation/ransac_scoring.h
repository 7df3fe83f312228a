// How RANSAC values one error, and in what order it samples. Part of ransac.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>

namespace rsfm {

enum class RansacScoring : std::uint8_t {
  kMsac,    // the squared error, truncated at the threshold   [Torr & Zisserman 2000, CVIU 78(1)]
  kMagsac,  // the same marginalised over noise levels up to the one whose 99 % bound the threshold
            // is: less sensitive to a threshold that is too wide   [Barath 2020, CVPR, "MAGSAC++"]
};

namespace internal {

// The loss of MAGSAC++ [Barath 2020, CVPR, eq. (5)] over (error / threshold)^2, scaled to 1 at the
// threshold, for errors of kDof (1 or 2) normal components; from a table of 256 straight pieces.
template <int kDof>
class MagsacLoss {
  static_assert(kDof == 1 || kDof == 2);

 public:
  static const MagsacLoss& Get() noexcept {
    static const MagsacLoss loss;
    return loss;
  }
  double operator()(double squared_ratio) const noexcept {
    const double place = squared_ratio * kPieces;
    const int i = std::min(static_cast<int>(place), kPieces - 1);
    return values_[i] + (place - i) * (values_[i + 1] - values_[i]);
  }

 private:
  static constexpr int kPieces = 256;

  MagsacLoss() noexcept {
    // Half of the squared 99 % quantile of the chi distribution.
    const double largest = 0.5 * (kDof == 1 ? 6.6349 : 9.2103);
    for (int i = 0; i <= kPieces; ++i) {
      const double x = largest * i / kPieces;
      values_[i] = 0.5 * Lower(x) + 0.5 * x * (Upper(x) - Upper(largest));
    }
    for (double& value : values_) value /= values_[kPieces];
  }
  // The incomplete gamma functions: the lower of (n + 1) / 2, the upper of (n - 1) / 2.
  static double Lower(double x) noexcept {
    if constexpr (kDof == 1) return -std::expm1(-x);
    return 0.5 * std::sqrt(std::numbers::pi) * std::erf(std::sqrt(x)) - std::sqrt(x) * std::exp(-x);
  }
  static double Upper(double x) noexcept {
    if constexpr (kDof == 1) return x > 0.0 ? -std::expint(-x) : 0.0;  // times x, whose limit is 0
    return std::sqrt(std::numbers::pi) * std::erfc(std::sqrt(x));
  }

  std::array<double, kPieces + 1> values_{};
};

// The growth of PROSAC's sampling set: at first only the best observations, all of them after about
// `max_samples`.   [Chum & Matas 2005, CVPR, "Matching with PROSAC", eqs. (3), (4)]
class ProsacGrowth {
 public:
  ProsacGrowth(int size, int sample_size, int max_samples) noexcept
      : size_(size), sample_size_(sample_size), pool_(sample_size), samples_(max_samples) {
    for (int i = 0; i < sample_size; ++i)
      samples_ *= static_cast<double>(sample_size - i) / (size - i);
  }
  // The pool for the next sample: the first pool() observations. With must_hold_last() the sample
  // holds the last of them and the others come from those before it.
  void Next() noexcept {
    ++drawn_;
    if (drawn_ > target_ && pool_ < size_) {
      const double more = samples_ * (pool_ + 1) / (pool_ + 1 - sample_size_);
      ++pool_;
      target_ += std::max(1.0, std::ceil(more - samples_));
      samples_ = more;
    }
    must_hold_last_ = drawn_ <= target_ && pool_ > sample_size_;
  }
  int pool() const { return pool_; }
  bool must_hold_last() const { return must_hold_last_; }

 private:
  int size_;
  int sample_size_;
  int pool_;
  double samples_;       // T_n: samples of the first n among max_samples random ones
  double target_ = 1.0;  // T'_n
  double drawn_ = 0.0;
  bool must_hold_last_ = false;
};

}  // namespace internal
}  // namespace rsfm

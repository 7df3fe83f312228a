// Robust losses, in the form that both solvers use: the cost of a residual r is rho(|r|^2) / 2.
//
// [Triggs 1999, "Bundle Adjustment: A Modern Synthesis", sec. 3.3; Ceres has the same definitions]
#pragma once

#include <cmath>
#include <cstdint>

namespace rsfm {

enum class LossType : std::uint8_t { kNone, kHuber, kCauchy };

struct RobustLoss {
  LossType type = LossType::kNone;
  double scale = 1.0;  // where it starts to bend, in the unit of the residual (sigmas); > 0

  // rho(squared_norm). rho(s) ~ s near zero.
  double Rho(double squared_norm) const noexcept {
    const double b = scale * scale;
    switch (type) {
      case LossType::kHuber:
        return squared_norm <= b ? squared_norm : 2.0 * scale * std::sqrt(squared_norm) - b;
      case LossType::kCauchy:
        return b * std::log1p(squared_norm / b);
      case LossType::kNone:
        break;
    }
    return squared_norm;
  }
  // rho'(squared_norm), in (0, 1]: the weight of the squared residual in the normal equations.
  double Weight(double squared_norm) const noexcept {
    const double b = scale * scale;
    switch (type) {
      case LossType::kHuber:
        return squared_norm <= b ? 1.0 : scale / std::sqrt(squared_norm);
      case LossType::kCauchy:
        return 1.0 / (1.0 + squared_norm / b);
      case LossType::kNone:
        break;
    }
    return 1.0;
  }
};

}  // namespace rsfm

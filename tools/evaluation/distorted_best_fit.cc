#include "tools/evaluation/distorted_best_fit.h"

#include <ceres/ceres.h>

#include <array>

#include "rsfm/camera/lens_list.h"
#include "rsfm/refraction/best_fit.h"

namespace rsfm {
namespace {

struct FitResidual {
  Vec3 point;
  Vec2 pixel;
  template <class T>
  bool operator()(const T* params, T* residual) const {
    Vec2T<T> projected;
    if (!OpenCV::ProjectT<T>(params, point.cast<T>(), &projected)) return false;
    residual[0] = projected.x() - pixel.x();
    residual[1] = projected.y() - pixel.y();
    return true;
  }
};

}  // namespace

std::optional<AnyCamera> FitWithDistortion(const AnyCamera& camera, double range_m) {
  constexpr int kColumns = 40, kRows = 25;
  const auto start = FitPerspective(camera);
  if (!start) return std::nullopt;
  std::array<double, 8> params = {start->fx, start->fy, start->cx, start->cy, 0.0, 0.0, 0.0, 0.0};
  ceres::Problem problem;
  for (int row = 0; row < kRows; ++row) {
    for (int column = 0; column < kColumns; ++column) {
      const Vec2 pixel((column + 0.5) / kColumns * camera.width(),
                       (row + 0.5) / kRows * camera.height());
      Ray3 ray;
      if (camera.Backproject(pixel, &ray) != Projection::kOk) continue;
      problem.AddResidualBlock(new ceres::AutoDiffCostFunction<FitResidual, 2, 8>(
                                   new FitResidual{ray.At(range_m), pixel}),
                               nullptr, params.data());
    }
  }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_QR;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  CameraConfig config = camera.config();
  config.port = PortConfig();
  config.lens = LensModel::kOpenCV;
  config.lens_params = {params[0], params[1], params[2], params[3],
                        params[4], params[5], params[6], params[7]};
  const auto fitted = AnyCamera::Create(config);
  if (!fitted) return std::nullopt;
  return *fitted;
}

}  // namespace rsfm

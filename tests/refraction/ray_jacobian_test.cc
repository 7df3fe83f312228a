// Derivatives of back-projection: the port's against automatic differentiation of the plain trace,
// the whole camera's, for every lens, against central differences; their limits.
#include <ceres/jet.h>
#include <gtest/gtest.h>

#include <cmath>

#include "rsfm/refraction/any_camera.h"
#include "tests/support/rigs.h"
#include "tests/support/traced_ray.h"

namespace rsfm {
namespace {

PortConfig PortOf(RigKind kind, Rng* rng) { return RandomRig(kind, rng).config().port; }

constexpr RigKind kPorts[] = {RigKind::kFlat, RigKind::kDome, RigKind::kCentredDome,
                              RigKind::kLayered};

TEST(PortRayJacobian, MatchesAutomaticDifferentiation) {
  constexpr int kSize = 3 + kNumPortParams + kNumOuterLayerParams;
  using Jet = ceres::Jet<double, kSize>;
  Rng rng(61);
  for (const RigKind kind : kPorts) {
    for (int rig = 0; rig < 200; ++rig) {
      const PortConfig config = PortOf(kind, &rng);
      const AnyPort port(config);
      Vec3 air = Vec3(rng.Uniform(-0.74, 0.74), rng.Uniform(-0.42, 0.42), 1.0).normalized();
      if (rig % 20 == 0) air = kind == RigKind::kCentredDome ? Vec3(0, 0, 1) : port.Axis();
      if (rig % 20 == 1) air = (port.Axis() + 1e-9 * air).normalized();
      PortNumbers<Jet> numbers(config);
      for (int i = 0; i < kNumPortParams; ++i) numbers.port[i].v[3 + i] = 1.0;
      for (std::size_t i = 0; i < numbers.layers.size(); ++i)
        numbers.layers[i].v[3 + kNumPortParams + i] = 1.0;
      const Vec3T<Jet> jet_air(Jet(air.x(), 0), Jet(air.y(), 1), Jet(air.z(), 2));
      Vec3T<Jet> origin, direction;
      ASSERT_TRUE(TraceRay(numbers, jet_air, &origin, &direction));
      Ray3 ray, plain;
      WaterJacobian jacobian;
      ASSERT_EQ(port.RefractToWater(air, &ray, &jacobian), Projection::kOk);
      ASSERT_EQ(port.RefractToWater(air, &plain), Projection::kOk);
      EXPECT_LT((ray.origin - plain.origin).norm() + (ray.direction - plain.direction).norm(),
                1e-14);
      // Only changes across the direction exist; a normal is one of unit length.
      const Mat3 across = Mat3::Identity() - air * air.transpose();
      const Mat3 of_normal =
          config.type == PortType::kFlat
              ? Mat3(Mat3::Identity() - config.normal * config.normal.transpose())
              : Mat3(Mat3::Identity());
      const auto compare = [&](const Vec3T<Jet>& jet, const Vec3& value, const Mat3& of_air,
                               const Eigen::Matrix<double, 3, kNumPortParams>& of_port,
                               const Eigen::Matrix<double, 3, kNumOuterLayerParams>& of_layers) {
        Eigen::Matrix<double, 3, kSize> expected;
        for (int row = 0; row < 3; ++row) {
          EXPECT_NEAR(jet[row].a, value[row], 1e-13);
          expected.row(row) = jet[row].v.transpose();
        }
        const double scale = 1e-11 * (1.0 + expected.norm());
        EXPECT_LT((of_air * across - expected.leftCols<3>() * across).norm(), scale);
        const Mat3 expected_vector = expected.block<3, 3>(0, 3) * of_normal;
        EXPECT_LT((of_port.leftCols<3>() - expected_vector).norm(), scale);
        EXPECT_LT((of_port.rightCols<5>() - expected.block<3, 5>(0, 6)).norm(), scale)
            << of_port.rightCols<5>() << "\n\n"
            << expected.block<3, 5>(0, 6);
        if (config.outer_layers.empty()) return;
        EXPECT_LT((of_layers - expected.rightCols<kNumOuterLayerParams>()).norm(), scale);
      };
      compare(origin, ray.origin, jacobian.d_origin_d_air, jacobian.d_origin_d_port,
              jacobian.d_origin_d_layers);
      compare(direction, ray.direction, jacobian.d_direction_d_air, jacobian.d_direction_d_port,
              jacobian.d_direction_d_layers);
    }
  }
}

// A mild distortion of every model.
CameraConfig MildLens(LensModel model, Rng* rng) {
  CameraConfig config = PaperLens();
  config.lens = model;
  config.lens_params.TryResize(NumLensParams(model));
  const int focals = NumFocalLengths(model);
  for (int i = 0; i < NumLensParams(model); ++i) {
    config.lens_params[i] = i < focals                  ? rng->Uniform(1000.0, 1400.0)
                            : i == focals               ? 960.0
                            : i == focals + 1           ? 540.0
                            : model == LensModel::kFov  ? 0.6
                            : model == LensModel::kEucm ? (i == focals + 2 ? 0.4 : 1.1)
                                                        : rng->Uniform(-0.01, 0.01);
  }
  return config;
}

TEST(RayJacobian, MatchesCentralDifferencesForEveryLens) {
  Rng rng(62);
  for (const LensModel model : AllLensModels()) {
    for (const RigKind kind : {RigKind::kNone, RigKind::kFlat, RigKind::kDome, RigKind::kLayered}) {
      CameraConfig config = MildLens(model, &rng);
      if (kind != RigKind::kNone) config.port = PortOf(kind, &rng);
      const AnyCamera camera = *AnyCamera::Create(config);
      const Vec2 pixel(rng.Uniform(100, 1800), rng.Uniform(100, 1000));
      Ray3 ray;
      RayJacobian jacobian;
      ASSERT_EQ(camera.Backproject(pixel, &ray, &jacobian), Projection::kOk) << ToString(model);
      const auto difference = [&](double h, auto&& at) {
        Eigen::Matrix<double, 6, 1> sum = Eigen::Matrix<double, 6, 1>::Zero();
        for (const auto& [steps, weight] :
             {std::pair{1.0, 8.0}, {-1.0, -8.0}, {2.0, -1.0}, {-2.0, 1.0}}) {
          const Ray3 moved = at(steps * h);
          sum.head<3>() += weight * moved.origin;
          sum.tail<3>() += weight * moved.direction;
        }
        return Eigen::Matrix<double, 6, 1>(sum / (12.0 * h));
      };
      const auto expect = [&](const Vec3& origin, const Vec3& direction,
                              const Eigen::Matrix<double, 6, 1>& numeric, const char* what, int k) {
        EXPECT_LT((origin - numeric.head<3>()).norm(), 1e-7 * (1e-3 + numeric.norm()))
            << ToString(model) << " " << what << " " << k;
        EXPECT_LT((direction - numeric.tail<3>()).norm(), 1e-7 * (1e-3 + numeric.norm()))
            << ToString(model) << " " << what << " " << k;
      };
      const auto traced = [&](const CameraConfig& moved, const Vec2& at) {
        Ray3 out;
        EXPECT_EQ(AnyCamera::Create(moved)->Backproject(at, &out), Projection::kOk);
        return out;
      };
      for (int k = 0; k < 2; ++k) {
        expect(jacobian.d_origin_d_pixel.col(k), jacobian.d_direction_d_pixel.col(k),
               difference(0.1, [&](double h) { return traced(config, pixel + h * Vec2::Unit(k)); }),
               "pixel", k);
      }
      for (int k = 0; k < NumLensParams(model); ++k) {
        const double h = k < NumFocalLengths(model) + 2 ? 0.1 : 1e-4;
        expect(jacobian.d_origin_d_lens.col(k), jacobian.d_direction_d_lens.col(k),
               difference(h,
                          [&](double step) {
                            CameraConfig moved = config;
                            moved.lens_params[k] += step;
                            return traced(moved, pixel);
                          }),
               "lens", k);
      }
      EXPECT_TRUE(
          jacobian.d_direction_d_lens.rightCols(kMaxLensParams - NumLensParams(model)).isZero());
      if (kind == RigKind::kNone) {
        EXPECT_TRUE(jacobian.d_origin_d_port.isZero() && jacobian.d_direction_d_port.isZero());
        continue;
      }
      for (const int k : {3, 4, 6, 7}) {
        expect(jacobian.d_origin_d_port.col(k), jacobian.d_direction_d_port.col(k),
               difference(1e-5,
                          [&](double step) {
                            CameraConfig moved = config;
                            PortParams params = config.port.Params();
                            params[k] += step;
                            moved.port.SetParams(params);
                            return traced(moved, pixel);
                          }),
               "port", k);
      }
    }
  }
}

// Value and derivative go to their limits: thin glass, a lens on the glass, a dome nearly centred.
TEST(RayJacobian, LimitsAreContinuous) {
  Rng rng(63);
  const auto compare = [](const CameraConfig& a, const CameraConfig& b, const Vec2& pixel,
                          double scale) {
    Ray3 ray_a, ray_b;
    RayJacobian at_a, at_b;
    ASSERT_EQ(AnyCamera::Create(a)->Backproject(pixel, &ray_a, &at_a), Projection::kOk);
    ASSERT_EQ(AnyCamera::Create(b)->Backproject(pixel, &ray_b, &at_b), Projection::kOk);
    EXPECT_LT((ray_a.origin - ray_b.origin).norm(), scale);
    EXPECT_LT((ray_a.direction - ray_b.direction).norm(), scale);
    EXPECT_LT((at_a.d_origin_d_pixel - at_b.d_origin_d_pixel).norm(), scale);
    EXPECT_LT((at_a.d_direction_d_pixel - at_b.d_direction_d_pixel).norm(), scale);
    EXPECT_LT((at_a.d_origin_d_lens - at_b.d_origin_d_lens).norm(), scale);
    EXPECT_LT((at_a.d_origin_d_port - at_b.d_origin_d_port).norm(), 1e3 * scale);
    EXPECT_LT((at_a.d_direction_d_port - at_b.d_direction_d_port).norm(), 1e3 * scale);
  };
  for (const RigKind kind : kPorts) {
    CameraConfig config = PaperLens();
    config.port = PortOf(kind, &rng);
    const Vec2 pixel(rng.Uniform(0, 1920), rng.Uniform(0, 1080));
    for (const double tiny : {1e-6, 1e-9, 1e-12, 1e-15, 1e-300}) {
      const double scale = 10.0 * tiny + 1e-13;
      CameraConfig thin = config, thinner = config;
      thin.port.thickness_m = tiny;
      thinner.port.thickness_m = 0.0;
      compare(thin, thinner, pixel, scale);
      CameraConfig near = config, on = config;
      if (config.port.type == PortType::kFlat) {
        near.port.distance_m = tiny;
        on.port.distance_m = 0.0;
      } else {
        near.port.center_m = tiny * Vec3(0.3, -0.4, 0.5);
        on.port.center_m.setZero();
      }
      compare(near, on, pixel, 1e2 * scale);
    }
  }
}

}  // namespace
}  // namespace rsfm

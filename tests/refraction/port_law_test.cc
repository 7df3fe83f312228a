// The laws of refraction, for every kind of port, over rigs from the paper's bounds and far beyond
// them.
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "rsfm/refraction/any_camera.h"
#include "rsfm/refraction/snell.h"
#include "tests/support/malloc_trap.h"
#include "tests/support/rigs.h"

namespace rsfm {
namespace {

// Within the paper's bounds, or (wild) up to the edges of what a camera file may say.
PortConfig RandomPort(RigKind kind, bool wild, Rng* rng) {
  PortConfig port = kind == RigKind::kFlat      ? RandomFlatPort(rng)
                    : kind == RigKind::kDome    ? RandomDomePort(rng)
                    : kind == RigKind::kLayered ? RandomLayeredPort(rng)
                                                : CentredDomePort();
  if (!wild) return port;
  port.index_glass = rng->Uniform(1.3, 2.4);
  port.index_water = rng->Uniform(1.0, 1.5);
  port.thickness_m = std::pow(10.0, rng->Uniform(-9.0, 0.0));
  for (PortLayer& layer : port.outer_layers) {
    layer.thickness_m = std::pow(10.0, rng->Uniform(-9.0, 0.0));
    layer.index = rng->Index(3) == 0 ? 1.0 : rng->Uniform(1.0, 2.4);
  }
  if (kind == RigKind::kFlat || kind == RigKind::kLayered) {
    port.normal = Vec3(rng->Uniform(-0.6, 0.6), rng->Uniform(-0.6, 0.6), 1.0).normalized();
    port.distance_m = rng->Index(5) == 0 ? 0.0 : std::pow(10.0, rng->Uniform(-9.0, 0.0));
  } else if (kind == RigKind::kDome) {
    port.radius_m = std::pow(10.0, rng->Uniform(-2.0, 0.0));
    const Vec3 direction = Vec3(rng->Gaussian(), rng->Gaussian(), rng->Gaussian()).normalized();
    port.center_m = port.radius_m * std::pow(10.0, rng->Uniform(-12.0, -0.2)) * direction;
  }
  return port;
}

AnyCamera CameraBehind(const PortConfig& port) {
  CameraConfig config = PaperLens();
  config.port = port;
  return *AnyCamera::Create(config);
}

Vec2 RandomPixel(Rng* rng) { return {rng->Uniform(0.0, 1920.0), rng->Uniform(0.0, 1080.0)}; }

class PortLaw : public ::testing::TestWithParam<RigKind> {
 protected:
  // f(camera, pixel, ray, point) over random rigs, pixels and ranges.
  template <class F>
  void ForEachRay(int rigs, F&& f) {
    Rng rng(21);
    for (int rig = 0; rig < rigs; ++rig) {
      const AnyCamera camera = CameraBehind(RandomPort(GetParam(), rig % 2 == 1, &rng));
      for (int i = 0; i < 20; ++i) {
        const Vec2 pixel = RandomPixel(&rng);
        Ray3 ray;
        if (camera.Backproject(pixel, &ray) != Projection::kOk) continue;
        f(camera, pixel, ray, ray.At(std::pow(10.0, rng.Uniform(-2.0, 2.0))));
      }
    }
  }
};
INSTANTIATE_TEST_SUITE_P(Ports, PortLaw,
                         ::testing::Values(RigKind::kFlat, RigKind::kDome, RigKind::kCentredDome,
                                           RigKind::kLayered));

TEST_P(PortLaw, ProjectInvertsBackproject) {
  int count = 0;
  ForEachRay(400,
             [&](const AnyCamera& camera, const Vec2& pixel, const Ray3& ray, const Vec3& point) {
               EXPECT_NEAR(ray.direction.norm(), 1.0, 1e-14);
               Vec2 again;
               ASSERT_EQ(camera.Project(point, &again), Projection::kOk) << point.transpose();
               EXPECT_LT((again - pixel).norm(), 1e-8) << point.transpose();
               Ray3 ray_again;
               ASSERT_EQ(camera.Backproject(again, &ray_again), Projection::kOk);
               EXPECT_LT(ray_again.Distance(point), 1e-10 * point.norm());
               ++count;
             });
  EXPECT_GT(count, 4000);
}

TEST_P(PortLaw, EqualIndicesAreNoPort) {
  Rng rng(22);
  for (int rig = 0; rig < 100; ++rig) {
    PortConfig port = RandomPort(GetParam(), rig % 2 == 1, &rng);
    port.index_glass = port.index_water = port.index_air;
    for (PortLayer& layer : port.outer_layers) layer.index = port.index_air;
    const AnyCamera camera = CameraBehind(port), bare = CameraBehind(PortConfig{});
    const Vec2 pixel = RandomPixel(&rng);
    Ray3 ray, bare_ray;
    if (camera.Backproject(pixel, &ray) != Projection::kOk) continue;
    ASSERT_EQ(bare.Backproject(pixel, &bare_ray), Projection::kOk);
    EXPECT_LT((ray.direction - bare_ray.direction).norm(), 1e-14);
    EXPECT_LT(bare_ray.Distance(ray.origin), 1e-12);
    Vec2 projected, bare_projected;
    Mat23 jacobian, bare_jacobian;
    ASSERT_EQ(camera.Project(ray.At(3.0), &projected, &jacobian), Projection::kOk);
    ASSERT_EQ(bare.Project(ray.At(3.0), &bare_projected, &bare_jacobian), Projection::kOk);
    EXPECT_LT((projected - bare_projected).norm(), 1e-9)
        << port.center_m.norm() / port.radius_m << " " << port.radius_m;
    EXPECT_LT((jacobian - bare_jacobian).norm(), 1e-8);
  }
}

// Light takes the path of stationary optical length: bending the crossing points changes it to
// second order only.
TEST_P(PortLaw, PathIsStationaryInOpticalLength) {
  Rng rng(23);
  for (int rig = 0; rig < 100; ++rig) {
    const PortConfig port = RandomPort(GetParam(), false, &rng);
    const AnyCamera camera = CameraBehind(port);
    const Vec2 pixel = RandomPixel(&rng);
    Ray3 ray;
    ASSERT_EQ(camera.Backproject(pixel, &ray), Projection::kOk);
    const Vec3 target = ray.At(2.0);
    Vec3 in_air((pixel.x() - 960.0) / 1297.37, (pixel.y() - 540.0) / 1297.37, 1.0);
    in_air.normalize();
    // The point of each surface that the direction v from `from` meets, and the optical length
    // through two such points.
    const auto meet = [&](const Vec3& from, const Vec3& v, double offset) -> Vec3 {
      if (port.type == PortType::kFlat) {
        return from + v * ((port.distance_m + offset - port.normal.dot(from)) / port.normal.dot(v));
      }
      const Vec3 c = from - port.center_m;
      const double radius = port.radius_m + offset, b = c.dot(v);
      return from + v * (std::sqrt(b * b - c.squaredNorm() + radius * radius) - b);
    };
    // Through the point where each layer ends; the first surface lies at offset zero.
    std::vector<double> offsets{0.0, port.thickness_m}, indices{port.index_air, port.index_glass};
    for (const PortLayer& layer : port.outer_layers) {
      offsets.push_back(offsets.back() + layer.thickness_m);
      indices.push_back(layer.index);
    }
    indices.push_back(port.index_water);
    const auto length = [&](const std::vector<Vec3>& crossings) {
      double sum = 0.0;
      Vec3 from = Vec3::Zero();
      for (std::size_t i = 0; i < crossings.size(); ++i) {
        sum += indices[i] * (crossings[i] - from).norm();
        from = crossings[i];
      }
      return sum + indices.back() * (target - from).norm();
    };
    std::vector<Vec3> crossings;
    Vec3 direction = in_air, from = Vec3::Zero();
    for (std::size_t i = 0; i < offsets.size(); ++i) {
      from = meet(from, direction, offsets[i]);
      crossings.push_back(from);
      const Vec3 normal =
          port.type == PortType::kFlat ? port.normal : (from - port.center_m).normalized();
      ASSERT_TRUE(Refract(direction, normal, indices[i] / indices[i + 1], &direction));
    }
    EXPECT_LT((crossings.back() - ray.origin).norm(), 1e-13);
    EXPECT_LT((direction - ray.direction).norm(), 1e-13);
    const double here = length(crossings), h = 1e-8;
    for (std::size_t i = 0; i < crossings.size(); ++i) {
      for (int k = 0; k < 3; ++k) {
        std::vector<Vec3> moved = crossings;
        moved[i] = meet(Vec3::Zero(), (crossings[i] + h * Vec3::Unit(k)).normalized(), offsets[i]);
        EXPECT_LT(std::abs(length(moved) - here), 1e5 * h * h);
      }
    }
  }
}

TEST_P(PortLaw, RayStaysInThePlaneOfIncidenceAndItsLineMeetsTheAxis) {
  ForEachRay(200, [&](const AnyCamera& camera, const Vec2& pixel, const Ray3& ray, const Vec3&) {
    const Vec3 in_air((pixel.x() - 960.0) / 1297.37, (pixel.y() - 540.0) / 1297.37, 1.0);
    const Vec3 axis = camera.RefractionAxis();
    const Vec3 plane = axis.cross(in_air);
    EXPECT_LT(std::abs(plane.dot(ray.origin)), 1e-13 * (1.0 + ray.origin.norm()));
    EXPECT_LT(std::abs(plane.dot(ray.direction)), 1e-13);
  });
}

// Central differences of fourth order against every column of every analytic derivative.
TEST_P(PortLaw, JacobiansMatchCentralDifferences) {
  Rng rng(24);
  for (int rig = 0; rig < 150; ++rig) {
    CameraConfig config = PaperLens();
    config.port = RandomPort(GetParam(), false, &rng);
    const AnyCamera camera = *AnyCamera::Create(config);
    Ray3 ray;
    ASSERT_EQ(camera.Backproject(RandomPixel(&rng), &ray), Projection::kOk);
    Vec3 point = ray.At(rng.Uniform(0.3, 8.0));
    if (rig % 10 == 0)
      point =
          (2.0 + rig * 0.01) * camera.RefractionAxis() * (camera.RefractionAxis().z() < 0 ? -1 : 1);
    Vec2 pixel, of_point_pixel, plain;
    CameraJacobian jacobian;
    Mat23 d_pixel_d_point;
    if (camera.Project(point, &plain) != Projection::kOk)
      continue;  // the axis of a dome may look sideways
    ASSERT_EQ(camera.Project(point, &pixel, &jacobian), Projection::kOk);
    ASSERT_EQ(camera.Project(point, &of_point_pixel, &d_pixel_d_point), Projection::kOk);
    EXPECT_LT((pixel - plain).norm(), 1e-9);
    EXPECT_LT((pixel - of_point_pixel).norm(), 1e-9);
    EXPECT_LT((d_pixel_d_point - jacobian.d_pixel_d_point).norm(),
              1e-9 * (1 + d_pixel_d_point.norm()));

    const auto difference = [&](double h, auto&& at) -> Vec2 {
      const Vec2 p1 = at(h), m1 = at(-h), p2 = at(2 * h), m2 = at(-2 * h);
      return (8.0 * (p1 - m1) - (p2 - m2)) / (12.0 * h);
    };
    for (int k = 0; k < 3; ++k) {
      const Vec2 numeric = difference(2e-3 * point.norm() * 0.05, [&](double h) {
        Vec2 out;
        EXPECT_EQ(camera.Project(point + h * Vec3::Unit(k), &out), Projection::kOk);
        return out;
      });
      EXPECT_LT((jacobian.d_pixel_d_point.col(k) - numeric).norm(),
                2e-6 * (1.0 + d_pixel_d_point.norm()))
          << k;
    }
    for (int k = 0; k < 4; ++k) {
      const Vec2 numeric = difference(1e-2, [&](double h) {
        CameraConfig moved = config;
        moved.lens_params[k] += h;
        Vec2 out;
        EXPECT_EQ(AnyCamera::Create(moved)->Project(point, &out), Projection::kOk);
        return out;
      });
      EXPECT_LT((jacobian.d_pixel_d_lens.col(k) - numeric).norm(), 1e-8 * (1.0 + numeric.norm()))
          << k;
    }
    EXPECT_TRUE(jacobian.d_pixel_d_lens.rightCols<kMaxLensParams - 4>().isZero());
    for (int k = 0; k < kNumPortParams; ++k) {
      const bool is_length = config.port.type == PortType::kDome ? k < 5 : k == 3 || k == 4;
      const bool of_normal = config.port.type == PortType::kFlat && k < 3;
      // A unit vector is differentiated as a normalised one: compare after normalising the moved
      // vector too.
      const Vec2 numeric = difference(is_length ? 1e-5 : 1e-4, [&](double h) {
        CameraConfig moved = config;
        PortParams params = config.port.Params();
        params[k] += h;
        moved.port.SetParams(params);
        if (of_normal) moved.port.normal.normalize();
        moved.port.index_air = std::max(moved.port.index_air, 1.0);
        if (k == 5) {  // indices below one are refused: scale all three, which changes nothing but
                       // the unit
          moved.port.index_air = (config.port.index_air + h) * 1.1;
          moved.port.index_glass *= 1.1;
          moved.port.index_water *= 1.1;
          for (PortLayer& layer : moved.port.outer_layers) layer.index *= 1.1;
        }
        Vec2 out;
        const auto moved_camera = AnyCamera::Create(moved);
        EXPECT_TRUE(moved_camera);
        EXPECT_EQ(moved_camera->Project(point, &out), Projection::kOk);
        return out;
      });
      EXPECT_LT((jacobian.d_pixel_d_port.col(k) - numeric).norm(), 2e-6 * (1.0 + numeric.norm()))
          << "port parameter " << k;
    }
    const int used = 2 * static_cast<int>(config.port.outer_layers.size());
    for (int k = 0; k < used; ++k) {
      const Vec2 numeric = difference(k % 2 == 0 ? 1e-5 : 1e-4, [&](double h) {
        CameraConfig moved = config;
        PortLayer& layer = moved.port.outer_layers[k / 2];
        (k % 2 == 0 ? layer.thickness_m : layer.index) += h;
        if (layer.index < 1.0) {  // refused: scale them all
          moved.port.index_air *= 1.1;
          moved.port.index_glass *= 1.1;
          moved.port.index_water *= 1.1;
          for (PortLayer& other : moved.port.outer_layers) other.index *= 1.1;
        }
        Vec2 out;
        EXPECT_EQ(AnyCamera::Create(moved)->Project(point, &out), Projection::kOk);
        return out;
      });
      EXPECT_LT((jacobian.d_pixel_d_layers.col(k) - numeric).norm(), 2e-6 * (1.0 + numeric.norm()))
          << "layer parameter " << k;
    }
    EXPECT_TRUE(jacobian.d_pixel_d_layers.rightCols(kNumOuterLayerParams - used).isZero());
  }
}

// Value and derivative do not jump where the geometry degenerates: next to the axis, for thin
// glass, a lens on the glass, a dome nearly centred.
TEST_P(PortLaw, LimitsAreContinuous) {
  Rng rng(25);
  for (int rig = 0; rig < 50; ++rig) {
    const PortConfig port = RandomPort(GetParam(), false, &rng);
    const Vec3 base(rng.Uniform(-0.5, 0.5), rng.Uniform(-0.5, 0.5), 2.0);
    const auto compare = [&](const PortConfig& a_port, const Vec3& a, const PortConfig& b_port,
                             const Vec3& b, double scale) {
      Vec2 pixel_a, pixel_b;
      CameraJacobian jacobian_a, jacobian_b;
      ASSERT_EQ(CameraBehind(a_port).Project(a, &pixel_a, &jacobian_a), Projection::kOk);
      ASSERT_EQ(CameraBehind(b_port).Project(b, &pixel_b, &jacobian_b), Projection::kOk);
      EXPECT_LT((pixel_a - pixel_b).norm(), scale);
      EXPECT_LT((jacobian_a.d_pixel_d_point - jacobian_b.d_pixel_d_point).norm(), scale);
      EXPECT_FALSE(jacobian_a.d_pixel_d_port.hasNaN());
      EXPECT_FALSE(jacobian_b.d_pixel_d_port.hasNaN());
      EXPECT_LT((jacobian_a.d_pixel_d_port - jacobian_b.d_pixel_d_port).norm(), 1e3 * scale);
    };
    for (const double tiny : {1e-6, 1e-9, 1e-12, 1e-15, 1e-20, 1e-300}) {
      const double scale = 2e5 * tiny + 1e-6;
      PortConfig thin = port, thinner = port;
      thin.thickness_m = tiny;
      thinner.thickness_m = 0.0;
      compare(thin, base, thinner, base, scale);
      if (port.type == PortType::kFlat) {
        PortConfig near = port, on = port;
        near.distance_m = tiny;
        on.distance_m = 0.0;
        compare(near, base, on, base, scale);
        const Vec3 on_axis = 2.0 * port.normal;
        compare(port, on_axis + tiny * Vec3(0.6, 0.8, 0.0), port, on_axis, scale);
      } else {
        PortConfig nearly = port, centred = port;
        nearly.center_m = tiny * Vec3(0.3, -0.4, 0.5);
        centred.center_m.setZero();
        compare(nearly, base, centred, base, scale);
        PortConfig backward = port;
        backward.center_m = Vec3(0.0, 0.0, 0.01);
        compare(backward, Vec3(tiny, -tiny, 3.0), backward, Vec3(0.0, 0.0, 3.0), scale);
      }
    }
  }
}

TEST_P(PortLaw, HotPathDoesNotAllocate) {
  Rng rng(26);
  const PortConfig port = RandomPort(GetParam(), false, &rng);
  MallocTrap trap;
  const AnyCamera camera = CameraBehind(port);
  Vec2 pixel;
  Ray3 ray;
  CameraJacobian jacobian;
  EXPECT_EQ(camera.Backproject(Vec2(300, 400), &ray), Projection::kOk);
  EXPECT_EQ(camera.Project(ray.At(2.0), &pixel, &jacobian), Projection::kOk);
  std::array<Vec2, 3> pixels{Vec2(1, 2), Vec2(900, 500), Vec2(1900, 1000)}, back;
  std::array<Ray3, 3> rays;
  std::array<Projection, 3> statuses;
  camera.Backproject(pixels, rays, statuses);
  std::array<Vec3, 3> points{rays[0].At(1), rays[1].At(2), rays[2].At(3)};
  camera.Project(points, back, statuses);
  EXPECT_EQ(trap.count(), 0u);
  for (int i = 0; i < 3; ++i) EXPECT_LT((back[i] - pixels[i]).norm(), 1e-9);
}

// Batches give what one-by-one gives: statuses exactly, pixels to rounding; points without a path
// among them.
TEST_P(PortLaw, BatchesAgreeWithSinglePoints) {
  Rng rng(28);
  for (int rig = 0; rig < 60; ++rig) {
    const AnyCamera camera = CameraBehind(RandomPort(GetParam(), rig % 2 == 1, &rng));
    std::vector<Vec3> points;
    for (int i = 0; i < 333; ++i) {
      points.push_back(std::pow(10.0, rng.Uniform(-3.0, 2.0)) *
                       Vec3(rng.Gaussian(), rng.Gaussian(), std::abs(rng.Gaussian())));
    }
    points[7].x() = std::nan("");
    points[70] = Vec3::Zero();
    points[100] = 3.0 * camera.RefractionAxis();
    std::vector<Vec2> pixels(points.size(), Vec2(-7, -7));
    std::vector<Projection> statuses(points.size());
    camera.Project(points, pixels, statuses);
    for (std::size_t i = 0; i < points.size(); ++i) {
      Vec2 pixel(-7, -7);
      ASSERT_EQ(statuses[i], camera.Project(points[i], &pixel))
          << i << " " << points[i].transpose();
      ASSERT_LT((pixels[i] - pixel).norm(), 1e-9 * (1.0 + 1e-3 * pixel.norm()))
          << i << " " << points[i].transpose();
    }
  }
}

TEST_P(PortLaw, BatchesOfBackprojectionsAgreeWithSingleOnes) {
  Rng rng(29);
  for (const LensModel model : {LensModel::kPinhole, LensModel::kOpenCV, LensModel::kOpenCVFisheye,
                                LensModel::kFov, LensModel::kThinPrismFisheye}) {
    for (int rig = 0; rig < 20; ++rig) {
      CameraConfig config = PaperLens();
      config.lens = model;
      config.lens_params.TryResize(NumLensParams(model));
      for (std::size_t k = 4; k < config.lens_params.size(); ++k)
        config.lens_params[k] = model == LensModel::kFov ? 0.6 : rng.Uniform(-0.02, 0.02);
      config.port = RandomPort(GetParam(), rig % 2 == 1, &rng);
      const AnyCamera camera = *AnyCamera::Create(config);
      std::vector<Vec2> pixels;
      for (int i = 0; i < 150; ++i)
        pixels.push_back((i % 10 == 0 ? 30.0 : 1.5) * (RandomPixel(&rng) - Vec2(960, 540)) +
                         Vec2(960, 540));
      pixels[3].x() = std::nan("");
      const Ray3 untouched{Vec3(-7, -7, -7), Vec3(-7, -7, -7)};
      std::vector<Ray3> rays(pixels.size(), untouched);
      std::vector<Projection> statuses(pixels.size());
      camera.Backproject(pixels, rays, statuses);
      for (std::size_t i = 0; i < pixels.size(); ++i) {
        Ray3 ray = untouched;
        ASSERT_EQ(statuses[i], camera.Backproject(pixels[i], &ray)) << pixels[i].transpose();
        ASSERT_LT((rays[i].origin - ray.origin).norm(), 1e-12 * (1.0 + ray.origin.norm()));
        // Near the critical angle the root magnifies rounding.
        ASSERT_LT((rays[i].direction - ray.direction).norm(), 1e-7);
        if (ray.direction.dot(camera.RefractionAxis()) > 0.1) {
          ASSERT_LT((rays[i].direction - ray.direction).norm(), 1e-13);
        }
      }
    }
  }
}

TEST(DomeLaw, CentredDomeIsCentralWhateverItsGlass) {
  const AnyCamera dome = CameraBehind(CentredDomePort()), bare = CameraBehind(PortConfig{});
  Rng rng(27);
  for (int i = 0; i < 100; ++i) {
    const Vec3 point(rng.Uniform(-1, 1), rng.Uniform(-1, 1), rng.Uniform(1, 5));
    Vec2 a, b;
    ASSERT_EQ(dome.Project(point, &a), Projection::kOk);
    ASSERT_EQ(bare.Project(point, &b), Projection::kOk);
    EXPECT_LT((a - b).norm(), 1e-10);
  }
}

}  // namespace
}  // namespace rsfm

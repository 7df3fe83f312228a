// The rendered image against the forward projection: two ways through the port that share no code
// but the camera's parameters.
#include "tools/simulator/renderer.h"

#include <gtest/gtest.h>

#include <cmath>

namespace rsfm::simulator {
namespace {

// A level plane with soft bright dots on a grid. Their sigma is some 1.5 px: the curvature of the
// projection shifts a dot's centroid by half its variance times the projection's Laplacian, which
// must stay small.
class DottedPlane final : public Scene {
 public:
  DottedPlane(double depth_m, double pitch_m, double sigma_m)
      : depth_m_(depth_m),
        pitch_(static_cast<float>(pitch_m)),
        sigma_(static_cast<float>(sigma_m)) {
    TriangleMesh mesh;
    mesh.vertices = {{-20, -20, 0}, {20, -20, 0}, {20, 20, 0}, {-20, 20, 0}};
    mesh.triangles = {{0, 3, 1}, {1, 3, 2}};  // normals up: -z
    ComputeNormals(&mesh);
    meshes_.push_back(mesh);
  }
  std::span<const TriangleMesh> meshes() const override { return meshes_; }
  Vec3 WorldOffset() const override { return Vec3(100.0, -50.0, depth_m_); }
  void Albedo(std::span<const SurfacePoint> points, std::span<Rgb> albedo) const override {
    for (std::size_t i = 0; i < points.size(); ++i) {
      const Vec3f& p = points[i].position_in_scene;
      const float dx = p.x() - pitch_ * std::round(p.x() / pitch_);
      const float dy = p.y() - pitch_ * std::round(p.y() / pitch_);
      const float value = std::exp(-0.5f * (dx * dx + dy * dy) / (sigma_ * sigma_));
      albedo[i] = {value, value, value};
    }
  }
  Vec3 DotInWorld(int i, int j) const {
    return WorldOffset() + static_cast<double>(pitch_) * Vec3(i, j, 0.0);
  }

 private:
  double depth_m_;
  float pitch_;
  float sigma_;
  std::vector<TriangleMesh> meshes_;
};

CameraConfig Lens() {
  CameraConfig config;
  config.lens = LensModel::kOpenCV;
  config.width = 400;
  config.height = 300;
  config.lens_params = {330.0, 335.0, 205.0, 148.0, -0.08, 0.02, 0.0005, -0.0008};
  return config;
}

PortConfig FlatPort() {
  PortConfig port;
  port.type = PortType::kFlat;
  port.normal = Vec3(0.12, -0.08, 1.0).normalized();
  port.distance_m = 0.05;
  port.thickness_m = 0.03;
  return port;
}

PortConfig DomePort() {
  PortConfig port;
  port.type = PortType::kDome;
  port.center_m = Vec3(0.006, -0.004, 0.02);
  port.radius_m = 0.06;
  port.thickness_m = 0.01;
  return port;
}

WaterOptions ClearWater() {
  WaterOptions options;
  options.attenuation = false;
  options.backscatter = false;
  options.strobe = false;
  return options;
}

SensorOptions IdealSensor() {
  SensorOptions options;
  options.noise = false;
  options.vignetting = false;
  options.gamma = false;
  options.grey = 0.3;  // albedo 0.35 gives this: white stays below 1
  return options;
}

struct Stage {
  AnyCamera camera;
  DottedPlane scene;
  std::unique_ptr<RayCaster> caster;
  Water water;
  Renderer renderer;

  Stage(const PortConfig& port, const SensorOptions& sensor, const WaterOptions& water_options,
        double dot_sigma_m = 0.005)
      : camera(*AnyCamera::Create([&] {
          CameraConfig config = Lens();
          config.port = port;
          return config;
        }())),
        scene(7.0, 0.2, dot_sigma_m),
        caster(RayCaster::Create(scene.meshes())),
        water(water_options, 1.5, sensor.grey),
        renderer(camera, scene, *caster, water, sensor, 2) {}
};

// Looks down on the plane from 1.5 m, a little aslant.
Rigid3 WorldFromCamera() { return {ExpSo3(Vec3(0.05, -0.08, 0.6)), Vec3(100.1, -50.2, 5.5)}; }

double Value(const RenderedImage& image, int x, int y) {
  return image.bgr[3 * (static_cast<std::size_t>(y) * image.width + x) + 1];
}

// Centroid of the brightness in a square window.
Vec2 Centroid(const RenderedImage& image, const Vec2& around, int reach) {
  const int cx = static_cast<int>(around.x());
  const int cy = static_cast<int>(around.y());
  Vec2 sum = Vec2::Zero();
  double weight = 0.0;
  for (int y = cy - reach; y <= cy + reach; ++y) {
    for (int x = cx - reach; x <= cx + reach; ++x) {
      const double value = Value(image, x, y);
      sum += value * Vec2(x + 0.5, y + 0.5);
      weight += value;
    }
  }
  return sum / weight;
}

void ExpectDotsWhereProjected(const PortConfig& port) {
  const Stage stage(port, IdealSensor(), ClearWater());
  const Rigid3 world_from_camera = WorldFromCamera();
  RenderedImage image;
  stage.renderer.Render(world_from_camera, 0, &image);
  ASSERT_EQ(image.width, 400);
  ASSERT_EQ(image.height, 300);
  const Rigid3 camera_from_world = world_from_camera.Inverse();
  constexpr int kReach = 7;
  int seen = 0;
  double worst = 0.0;
  Vec2 mean = Vec2::Zero();
  for (int i = -12; i <= 12; ++i) {
    for (int j = -12; j <= 12; ++j) {
      Vec2 pixel;
      const Vec3 point = camera_from_world * stage.scene.DotInWorld(i, j);
      if (stage.camera.Project(point, &pixel) != Projection::kOk) continue;
      if (pixel.x() < kReach + 1 || pixel.y() < kReach + 1) continue;
      if (pixel.x() > 399 - kReach || pixel.y() > 299 - kReach) continue;
      const Vec2 error = Centroid(image, pixel, kReach) - pixel;
      worst = std::max(worst, error.norm());
      mean += error;
      ++seen;
    }
  }
  ASSERT_GT(seen, 20);
  EXPECT_LT(worst, 0.05);
  EXPECT_LT((mean / seen).norm(), 0.01);
}

TEST(RendererTest, FlatPortShowsPointsWhereTheyProject) { ExpectDotsWhereProjected(FlatPort()); }
TEST(RendererTest, DomePortShowsPointsWhereTheyProject) { ExpectDotsWhereProjected(DomePort()); }
TEST(RendererTest, NoPortShowsPointsWhereTheyProject) { ExpectDotsWhereProjected(PortConfig{}); }

// The test above would not notice a port that does nothing, if refraction were small here.
TEST(RendererTest, RefractionMattersInTheseRigs) {
  CameraConfig config = Lens();
  const AnyCamera bare = *AnyCamera::Create(config);
  for (const PortConfig& port : {FlatPort(), DomePort()}) {
    config.port = port;
    const AnyCamera camera = *AnyCamera::Create(config);
    Vec2 with, without;
    ASSERT_EQ(camera.Project(Vec3(0.5, 0.3, 1.5), &with), Projection::kOk);
    ASSERT_EQ(bare.Project(Vec3(0.5, 0.3, 1.5), &without), Projection::kOk);
    EXPECT_GT((with - without).norm(), 0.5);
  }
}

TEST(RendererTest, RangeIsThatOfTheRayInWater) {
  const Stage stage(FlatPort(), IdealSensor(), ClearWater());
  const Rigid3 world_from_camera = WorldFromCamera();
  std::vector<float> range_m;
  stage.renderer.RenderRange(world_from_camera, &range_m);
  for (const auto& [x, y] : {std::pair{10, 10}, {200, 150}, {390, 20}, {30, 280}}) {
    Ray3 ray;
    ASSERT_EQ(stage.camera.Backproject(Vec2(x + 0.5, y + 0.5), &ray), Projection::kOk);
    const Vec3 origin = world_from_camera * ray.origin;
    const Vec3 direction = world_from_camera.rotation * ray.direction;
    const double expected = (7.0 - origin.z()) / direction.z();
    EXPECT_NEAR(range_m[static_cast<std::size_t>(y) * 400 + x], expected, 1e-5);
  }
}

// A camera that moves along its own x smears a dot along x by the way it goes, about its middle.
TEST(RendererTest, MotionBlurSmearsAlongTheMotionAboutItsMiddle) {
  SensorOptions sensor = IdealSensor();
  sensor.samples_per_pixel = 16;
  const Stage stage(PortConfig{}, sensor, ClearWater());
  const Rigid3 middle = WorldFromCamera();
  const double smear_m = 0.03;  // 6.6 px at 1.5 m
  std::vector<Rigid3> poses;
  for (int i = 0; i < 16; ++i) {
    const double share = (i + 0.5) / 16 - 0.5;
    poses.push_back({middle.rotation, middle * Vec3(share * smear_m, 0.0, 0.0)});
  }
  RenderedImage sharp, blurred;
  stage.renderer.Render(middle, 0, &sharp);
  stage.renderer.Render(poses, 0, &blurred);
  const auto spread = [](const RenderedImage& image, const Vec2& around) {
    const Vec2 mean = Centroid(image, around, 9);
    Vec2 sum = Vec2::Zero();
    double weight = 0.0;
    for (int y = static_cast<int>(around.y()) - 9; y <= around.y() + 9; ++y) {
      for (int x = static_cast<int>(around.x()) - 9; x <= around.x() + 9; ++x) {
        const double value = Value(image, x, y);
        sum += value * (Vec2(x + 0.5, y + 0.5) - mean).cwiseAbs2();
        weight += value;
      }
    }
    return Vec2(sum / weight);
  };
  const Rigid3 camera_from_world = middle.Inverse();
  int seen = 0;
  double expected = 0.0;
  Vec2 growth = Vec2::Zero(), shift = Vec2::Zero();
  for (int i = -12; i <= 12; ++i) {
    for (int j = -12; j <= 12; ++j) {
      Vec2 pixel;
      const Vec3 point = camera_from_world * stage.scene.DotInWorld(i, j);
      if (stage.camera.Project(point, &pixel) != Projection::kOk) continue;
      if ((pixel - Vec2(200, 150)).cwiseAbs().maxCoeff() > 130) continue;
      const Vec2 grown = spread(blurred, pixel) - spread(sharp, pixel);
      const double smear_px = 330.0 * smear_m / point.z();
      growth += grown;
      expected += smear_px * smear_px / 12.0;  // of an even smear
      shift += Centroid(blurred, pixel, 9) - Centroid(sharp, pixel, 9);
      ++seen;
    }
  }
  ASSERT_GT(seen, 10);
  EXPECT_NEAR(growth.x() / expected, 1.0, 0.1);
  EXPECT_NEAR(growth.y() / expected, 0.0, 0.05);
  EXPECT_LT((shift / seen).norm(), 0.05);
}

TEST(RendererTest, NoiseHasTheSensorsVarianceAndFollowsFrameAndSeed) {
  SensorOptions noisy = IdealSensor();
  noisy.noise = true;
  noisy.full_well_electrons = 1000.0;
  noisy.read_noise_electrons = 20.0;
  constexpr double kWideDots = 0.06;
  const Stage clean(FlatPort(), IdealSensor(), ClearWater(), kWideDots);
  const Stage first(FlatPort(), noisy, ClearWater(), kWideDots);
  noisy.seed = 2;
  const Stage second(FlatPort(), noisy, ClearWater(), kWideDots);
  RenderedImage truth, a, again, other_frame, other_seed;
  clean.renderer.Render(WorldFromCamera(), 3, &truth);
  first.renderer.Render(WorldFromCamera(), 3, &a);
  first.renderer.Render(WorldFromCamera(), 3, &again);
  first.renderer.Render(WorldFromCamera(), 4, &other_frame);
  second.renderer.Render(WorldFromCamera(), 3, &other_seed);
  EXPECT_EQ(a.bgr, again.bgr);
  EXPECT_NE(a.bgr, other_frame.bgr);
  EXPECT_NE(a.bgr, other_seed.bgr);

  // Middle tones only, which the limits of 8 bits do not cut.
  double sum = 0.0, squares = 0.0, expected = 0.0;
  int count = 0;
  for (std::size_t i = 0; i < truth.bgr.size(); ++i) {
    const double level = truth.bgr[i] / 255.0;
    if (level < 0.25 || level > 0.6) continue;
    const double error = (a.bgr[i] - truth.bgr[i]) / 255.0;
    sum += error;
    squares += error * error;
    expected += (20.0 * 20.0 + 1000.0 * level) / 1e6;
    ++count;
  }
  ASSERT_GT(count, 5000);
  EXPECT_NEAR(sum / count, 0.0, 0.002);
  EXPECT_NEAR(squares / expected, 1.0, 0.08);
}

TEST(RendererTest, VignettingDarkensTheCornersAlone) {
  SensorOptions sensor = IdealSensor();
  const Stage even(PortConfig{}, sensor, ClearWater());
  sensor.vignetting = true;
  sensor.vignetting_at_corner = 0.5;
  const Stage dark(PortConfig{}, sensor, ClearWater());
  RenderedImage a, b;
  even.renderer.Render(WorldFromCamera(), 0, &a);
  dark.renderer.Render(WorldFromCamera(), 0, &b);
  double corner[2] = {0.0, 0.0}, center[2] = {0.0, 0.0};
  for (int y = 0; y < 30; ++y) {
    for (int x = 0; x < 30; ++x) {
      corner[0] += Value(a, x, y);
      corner[1] += Value(b, x, y);
      center[0] += Value(a, 185 + x, 135 + y);
      center[1] += Value(b, 185 + x, 135 + y);
    }
  }
  EXPECT_NEAR(center[1] / center[0], 1.0, 0.02);
  EXPECT_NEAR(corner[1] / corner[0], 0.55, 0.04);  // 1 - 0.5 (1 - 15 / 200)^2 and the like
}

TEST(WaterTest, LightFallsOffAsTheFormulaSays) {
  WaterOptions options;
  options.backscatter = false;
  options.white_balance = 0.0;
  options.ambient = 0.0;
  options.strobes = {{Vec3::Zero(), 90.0}};
  const Water water(options, 2.0, 0.2);
  const Rgb albedo = {0.35f, 0.35f, 0.35f};
  const Vec3f normal(0.0f, 0.0f, -1.0f);
  for (const float range : {0.5f, 1.0f, 2.0f, 3.7f}) {
    const Rgb value = water.Shade(Vec3f(0.0f, 0.0f, range), normal, range, albedo);
    for (int c = 0; c < 3; ++c) {
      const double path = 2.0 * range;
      const double expected =
          0.2 * 4.0 / (range * range) *
          std::exp(-options.attenuation_per_m[c] * path + options.attenuation_per_m[1] * 4.0);
      EXPECT_NEAR(value[c], expected, 2e-4 * expected) << range << " " << c;
    }
  }
}

TEST(WaterTest, BackscatterGrowsToTheVeil) {
  WaterOptions options;
  const Water water(options, 2.0, 0.2);
  const Rgb black = {0.0f, 0.0f, 0.0f};
  const Vec3f normal(0.0f, 0.0f, -1.0f);
  const Rgb near = water.Shade(Vec3f(0.0f, 0.0f, 1.0f), normal, 1.0f, black);
  const Rgb far = water.Shade(Vec3f(0.0f, 0.0f, 80.0f), normal, 80.0f, black);
  for (int c = 0; c < 3; ++c) {
    const double level = options.backscatter_level[c];
    EXPECT_NEAR(near[c], level * (1.0 - std::exp(-options.backscatter_per_m[c])), 1e-4 * level);
    EXPECT_NEAR(far[c], water.Veil()[c], 1e-4 * level);
  }
}

}  // namespace
}  // namespace rsfm::simulator

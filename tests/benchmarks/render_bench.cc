// The simulator's speed: 1280 x 960 pixels, 4 samples each, behind a tilted flat port, on two
// threads; images per second, and the ratio to what one writes first, in the same run.
//
// The baseline back-projects every sample through the port anew for each image, traces each ray
// alone and shades each sample with exponentials of the same water. It renders every eighth row.
#include <benchmark/benchmark.h>

#include <chrono>
#include <cmath>

#include "tools/common/parallel.h"
#include "tools/simulator/renderer.h"
#include "tools/simulator/seafloor.h"
#include "tools/simulator/tank.h"

namespace rsfm::simulator {
namespace {

constexpr int kThreads = 2;
constexpr int kBaselineStep = 8;

double SecondsSince(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

CameraConfig Rig() {
  CameraConfig config;
  config.lens = LensModel::kOpenCV;
  config.width = 1280;
  config.height = 960;
  config.lens_params = {865.0, 865.0, 640.0, 480.0, -0.1, 0.02, 0.0, 0.0};
  config.port.type = PortType::kFlat;
  config.port.normal = Vec3(0.166, 0.148, 0.975).normalized();
  config.port.distance_m = 0.05;
  config.port.thickness_m = 0.01;
  return config;
}

// An image without any preparation.
class PlainRenderer {
 public:
  PlainRenderer(const AnyCamera& camera, const Scene& scene, const RayCaster& caster,
                const WaterOptions& water)
      : camera_(camera), scene_(scene), caster_(caster), water_(water) {}

  // Every kBaselineStep-th row; the sum keeps the compiler honest.
  double Render(const Rigid3& world_from_camera) const {
    double sum = 0.0;
    for (int y = 0; y < camera_.height(); y += kBaselineStep) {
      for (int x = 0; x < camera_.width(); ++x) {
        Vec3 colour = Vec3::Zero();
        for (int s = 0; s < 4; ++s) {
          const Vec2 pixel(x + 0.25 + 0.5 * (s % 2), y + 0.25 + 0.5 * (s / 2));
          colour += 0.25 * Sample(world_from_camera, pixel);
        }
        for (int c = 0; c < 3; ++c) sum += std::pow(std::clamp(colour[c], 0.0, 1.0), 1.0 / 2.2);
      }
    }
    return sum;
  }

 private:
  Vec3 Sample(const Rigid3& world_from_camera, const Vec2& pixel) const {
    Ray3 ray;
    if (camera_.Backproject(pixel, &ray) != Projection::kOk) return Vec3::Zero();
    const Vec3 origin = world_from_camera * ray.origin - scene_.WorldOffset();
    const Vec3 direction = world_from_camera.rotation * ray.direction;
    const auto hit = caster_.Trace(origin.cast<float>(), direction.cast<float>());
    if (!hit) return water_.backscatter_level;
    SurfacePoint point;
    point.position_in_scene = (origin + hit->range_m * direction).cast<float>();
    point.footprint_m = hit->range_m * 0.0006f;
    point.mesh = hit->mesh;
    point.triangle = hit->triangle;
    point.u = hit->u;
    point.v = hit->v;
    Rgb albedo;
    scene_.Albedo({&point, 1}, {&albedo, 1});
    const Vec3 at = ray.origin + hit->range_m * ray.direction;
    const Vec3 normal = world_from_camera.rotation.conjugate() * Vec3(0.0, 0.0, -1.0);
    Vec3 light = Vec3::Constant(water_.ambient);
    for (const Strobe& strobe : water_.strobes) {
      const Vec3 way = at - strobe.position_in_camera;
      const double d = way.norm();
      const double cosine = std::max(0.0, -way.dot(normal) / d);
      light += cosine / (d * d) * (-water_.attenuation_per_m * d).array().exp().matrix();
    }
    Vec3 value;
    for (int c = 0; c < 3; ++c) {
      const double seen = std::exp(-water_.attenuation_per_m[c] * hit->range_m);
      const double veil = 1.0 - std::exp(-water_.backscatter_per_m[c] * hit->range_m);
      value[c] = albedo[c] * light[c] * seen + water_.backscatter_level[c] * veil;
    }
    return value;
  }

  const AnyCamera& camera_;
  const Scene& scene_;
  const RayCaster& caster_;
  const WaterOptions& water_;
};

void Run(benchmark::State& state, const Scene& scene, const Rigid3& world_from_camera,
         double exposed_range_m) {
  const AnyCamera camera = *AnyCamera::Create(Rig());
  const auto caster = RayCaster::Create(scene.meshes());
  const WaterOptions water_options;
  const SensorOptions sensor;
  const Water water(water_options, exposed_range_m, sensor.grey);
  const Renderer renderer(camera, scene, *caster, water, sensor, kThreads);
  const PlainRenderer plain(camera, scene, *caster, water_options);
  const auto start = std::chrono::steady_clock::now();
  ParallelFor(kThreads, kThreads,
              [&](int) { benchmark::DoNotOptimize(plain.Render(world_from_camera)); });
  const double plain_s = SecondsSince(start) * kBaselineStep / kThreads;
  double seconds = 0.0;
  for (auto _ : state) {
    const auto begin = std::chrono::steady_clock::now();
    ParallelFor(kThreads, kThreads, [&](int i) {
      RenderedImage image;
      renderer.Render(world_from_camera, static_cast<std::uint32_t>(i), &image);
      benchmark::DoNotOptimize(image.bgr.data());
    });
    seconds += SecondsSince(begin);
  }
  const double per_image_s = seconds / static_cast<double>(state.iterations() * kThreads);
  state.counters["images_per_s"] = 1.0 / per_image_s;
  state.counters["times_faster_than_plain"] = plain_s / per_image_s;
}

void Tank(benchmark::State& state) {
  const auto scene = MakeTank({}, kThreads);
  Mat3 world_from_camera;
  world_from_camera << 0.0, -0.77, -0.64, 1.0, 0.0, 0.0, 0.0, -0.64, 0.77;
  Run(state, *scene, {Quat(world_from_camera).normalized(), Vec3(0.6, 0.0, 0.15)}, 1.1);
}

void SeafloorPatch(benchmark::State& state) {
  const auto scene = MakeSeafloor({}, kThreads);
  Run(state, *scene, {ExpSo3(Vec3(0.05, -0.03, 1.5)), Vec3(0.2, 0.3, 18.0)}, 2.0);
}

BENCHMARK(Tank)->UseRealTime()->Unit(benchmark::kMillisecond)->Iterations(6);
BENCHMARK(SeafloorPatch)->UseRealTime()->Unit(benchmark::kMillisecond)->Iterations(6);

}  // namespace
}  // namespace rsfm::simulator

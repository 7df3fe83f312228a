#include "tools/simulator/renderer.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <numbers>
#include <thread>

#include "tools/simulator/noise.h"

namespace rsfm::simulator {
namespace {

constexpr int kNoiseBits = 12;
constexpr int kToneSteps = 8192;

// Sample `index` of k x k in a pixel: each in its own cell, row and column, their mean the centre.
// [Kensler 2013, Pixar TM 13-01, "Correlated multi-jittered sampling", the canonical arrangement]
Vec2 SampleOffset(int index, int k) {
  const int i = index % k;
  const int j = index / k;
  return Vec2((i + (j + 0.5) / k) / k, (j + (i + 0.5) / k) / k);
}

// Inverse of the normal distribution by bisection, to 1e-6.
float NormalQuantile(double probability) {
  double low = -8.0;
  double high = 8.0;
  for (int i = 0; i < 24; ++i) {
    const double middle = 0.5 * (low + high);
    (0.5 * std::erfc(-middle / std::numbers::sqrt2) < probability ? low : high) = middle;
  }
  return static_cast<float>(0.5 * (low + high));
}

double SrgbFromLinear(double v) {
  return v <= 0.0031308 ? 12.92 * v : 1.055 * std::pow(v, 1.0 / 2.4) - 0.055;
}

void TransformRays(const Rigid3& b_from_a, const RaySoa& in_a, RaySoa* in_b) {
  const Eigen::Matrix3f r = b_from_a.rotation.toRotationMatrix().cast<float>();
  const Vec3f t = b_from_a.translation.cast<float>();
  const std::size_t size = in_a.size();
  const float *ox = in_a.ox.data(), *oy = in_a.oy.data(), *oz = in_a.oz.data();
  const float *dx = in_a.dx.data(), *dy = in_a.dy.data(), *dz = in_a.dz.data();
  float* const origin[3] = {in_b->ox.data(), in_b->oy.data(), in_b->oz.data()};
  float* const direction[3] = {in_b->dx.data(), in_b->dy.data(), in_b->dz.data()};
  for (int row = 0; row < 3; ++row) {
    const float a = r(row, 0), b = r(row, 1), c = r(row, 2), d = t[row];
    float* o = origin[row];
    float* e = direction[row];
    for (std::size_t i = 0; i < size; ++i) {
      o[i] = a * ox[i] + b * oy[i] + c * oz[i] + d;
      e[i] = a * dx[i] + b * dy[i] + c * dz[i];
    }
  }
}

// Sample `s` of pixel x takes pose (s + the pixel's shift) modulo their number: where in a pixel a
// sample lies then has nothing to do with when it is taken.
void TransformMovingRays(std::span<const Rigid3> b_from_a, std::uint32_t samples,
                         std::uint32_t seed, const RaySoa& in_a, RaySoa* in_b) {
  std::vector<Eigen::Matrix3f> rotations;
  std::vector<Vec3f> translations;
  for (const Rigid3& pose : b_from_a) {
    rotations.push_back(pose.rotation.toRotationMatrix().cast<float>());
    translations.push_back(pose.translation.cast<float>());
  }
  const auto poses = static_cast<std::uint32_t>(b_from_a.size());
  for (std::uint32_t i = 0; i < in_a.size(); ++i) {
    const std::uint32_t k = (i % samples + Hash(i / samples, seed)) % poses;
    const Vec3f origin = rotations[k] * Vec3f(in_a.ox[i], in_a.oy[i], in_a.oz[i]) + translations[k];
    const Vec3f direction = rotations[k] * Vec3f(in_a.dx[i], in_a.dy[i], in_a.dz[i]);
    in_b->ox[i] = origin.x();
    in_b->oy[i] = origin.y();
    in_b->oz[i] = origin.z();
    in_b->dx[i] = direction.x();
    in_b->dy[i] = direction.y();
    in_b->dz[i] = direction.z();
  }
}

Vec3f InterpolatedNormal(const TriangleMesh& mesh, const RayHit& hit) {
  const auto& [a, b, c] = mesh.triangles[hit.triangle];
  const Vec3f& first = mesh.normals[a];
  const Vec3f sum = first + hit.u * (mesh.normals[b] - first) + hit.v * (mesh.normals[c] - first);
  return sum * (1.0f / std::sqrt(sum.squaredNorm()));
}

}  // namespace

struct Renderer::Scratch {
  RaySoa rays_in_scene;
  std::vector<RayHit> hits;
  std::vector<SurfacePoint> points;
  std::vector<std::uint32_t> sample_of_point;
  std::vector<Rgb> albedo;
};

Renderer::Renderer(const AnyCamera& camera, const Scene& scene, const RayCaster& caster,
                   const Water& water, const SensorOptions& options, int num_threads)
    : camera_(camera), scene_(scene), caster_(caster), water_(water), options_(options) {
  samples_ = std::max(1, options.samples_per_pixel);
  MakeRays(num_threads);
  MakeNoiseTable();
  tone_curve_.resize(kToneSteps + 1);
  for (int i = 0; i <= kToneSteps; ++i) {
    const double linear = static_cast<double>(i) / kToneSteps;
    const double tone = options_.gamma ? SrgbFromLinear(linear) : linear;
    tone_curve_[i] = static_cast<std::uint8_t>(255.0 * tone + 0.5);
  }
}

void Renderer::MakeRays(int num_threads) {
  const int k = static_cast<int>(std::lround(std::sqrt(samples_)));
  sample_angle_rad_ = static_cast<float>(1.0 / (camera_.MeanFocalLength() * k));
  rows_.resize(camera_.height());
  std::atomic<int> next_row = 0;
  std::atomic<std::int64_t> covered = 0;
  const auto work = [&] {
    for (int y = next_row++; y < camera_.height(); y = next_row++) {
      RaySoa& row = rows_[y];
      row.Resize(static_cast<std::size_t>(camera_.width()) * samples_);
      std::int64_t found = 0;
      for (std::size_t i = 0; i < row.size(); ++i) {
        const int x = static_cast<int>(i) / samples_;
        const Vec2 pixel = Vec2(x, y) + SampleOffset(static_cast<int>(i) % samples_, k);
        Ray3 ray;
        if (camera_.Backproject(pixel, &ray) != Projection::kOk) {
          row.dx[i] = row.dy[i] = row.dz[i] = 0.0f;
          continue;
        }
        ++found;
        row.ox[i] = static_cast<float>(ray.origin.x());
        row.oy[i] = static_cast<float>(ray.origin.y());
        row.oz[i] = static_cast<float>(ray.origin.z());
        row.dx[i] = static_cast<float>(ray.direction.x());
        row.dy[i] = static_cast<float>(ray.direction.y());
        row.dz[i] = static_cast<float>(ray.direction.z());
      }
      covered += found;
    }
  };
  std::vector<std::jthread> threads;
  for (int i = 1; i < num_threads; ++i) threads.emplace_back(work);
  work();
  threads.clear();
  covered_fraction_ = static_cast<double>(covered.load()) /
                      (static_cast<double>(camera_.width()) * camera_.height() * samples_);
}

void Renderer::MakeNoiseTable() {
  gaussian_.resize(1u << kNoiseBits);
  const auto size = static_cast<double>(gaussian_.size());
  for (std::size_t i = 0; i < gaussian_.size(); ++i) {
    gaussian_[i] = NormalQuantile((static_cast<double>(i) + 0.5) / size);
  }
}

void Renderer::Develop(const Rgb& linear, int x, int y, std::uint32_t frame,
                       std::uint8_t* bgr) const {
  Rgb value = linear;
  if (options_.vignetting) {
    const float half_width = 0.5f * static_cast<float>(camera_.width());
    const float half_height = 0.5f * static_cast<float>(camera_.height());
    const float dx = static_cast<float>(x) + 0.5f - half_width;
    const float dy = static_cast<float>(y) + 0.5f - half_height;
    const float loss = static_cast<float>(options_.vignetting_at_corner) * (dx * dx + dy * dy) /
                       (half_width * half_width + half_height * half_height);
    for (float& channel : value) channel *= 1.0f - loss;
  }
  if (options_.noise) {
    const auto index = static_cast<std::uint32_t>(y * camera_.width() + x);
    const std::uint32_t hash = Hash(index, frame,
                                    static_cast<std::uint32_t>(options_.seed) ^
                                        Hash(static_cast<std::uint32_t>(options_.seed >> 32)));
    const std::uint32_t draws[3] = {hash >> 20, (hash >> 8) & 0xFFFu, Hash(hash) >> 20};
    const auto well = static_cast<float>(options_.full_well_electrons);
    const auto read = static_cast<float>(options_.read_noise_electrons);
    for (int c = 0; c < 3; ++c) {
      const float sigma = std::sqrt(read * read + well * std::max(value[c], 0.0f)) / well;
      value[c] += sigma * gaussian_[draws[c]];
    }
  }
  for (int c = 0; c < 3; ++c) {
    const float step = std::clamp(value[c], 0.0f, 1.0f) * static_cast<float>(kToneSteps) + 0.5f;
    bgr[2 - c] = tone_curve_[static_cast<int>(step)];
  }
}

// The light on a pixel's samples differs little where they lie on one mesh: it is then computed
// once, at the mean of the two samples next to the centre, which lie on opposite sides of it.
void Renderer::ShadePixel(const Eigen::Matrix3f& camera_from_scene, std::size_t first_sample,
                          std::size_t first_point, std::size_t num_points, const RaySoa& rays,
                          Scratch* scratch, Rgb* pixel) const {
  const Scratch& s = *scratch;
  const auto point_of = [&](std::size_t sample) {
    return Vec3f(Vec3f(rays.ox[sample], rays.oy[sample], rays.oz[sample]) +
                 s.hits[sample].range_m * Vec3f(rays.dx[sample], rays.dy[sample], rays.dz[sample]));
  };
  const std::span<const TriangleMesh> meshes = scene_.meshes();
  const auto normal_of = [&](std::size_t sample) {
    return InterpolatedNormal(meshes[s.hits[sample].mesh], s.hits[sample]);
  };
  const std::size_t count = samples_;
  bool is_one_mesh = num_points == count;
  for (std::size_t i = 1; i < num_points; ++i) {
    is_one_mesh &= s.points[first_point + i].mesh == s.points[first_point].mesh;
  }
  if (is_one_mesh) {
    const std::size_t a = first_sample + (count - 1) / 2;
    const std::size_t b = first_sample + count / 2;
    Rgb albedo = {0.0f, 0.0f, 0.0f};
    for (std::size_t i = 0; i < count; ++i) {
      for (int c = 0; c < 3; ++c) albedo[c] += s.albedo[first_point + i][c];
    }
    const Vec3f normal = camera_from_scene * (normal_of(a) + normal_of(b));
    *pixel = water_.Shade(0.5f * (point_of(a) + point_of(b)), normal.normalized(),
                          0.5f * (s.hits[a].range_m + s.hits[b].range_m), albedo,
                          static_cast<float>(count));
    return;
  }
  std::size_t p = first_point;
  for (std::size_t i = first_sample; i < first_sample + count; ++i) {
    Rgb value = {0.0f, 0.0f, 0.0f};
    if (p < first_point + num_points && s.sample_of_point[p] == i) {
      value = water_.Shade(point_of(i), camera_from_scene * normal_of(i), s.hits[i].range_m,
                           s.albedo[p], 1.0f);
      ++p;
    } else if (rays.dx[i] != 0.0f || rays.dy[i] != 0.0f || rays.dz[i] != 0.0f) {
      value = water_.Veil();
    }
    for (int c = 0; c < 3; ++c) (*pixel)[c] += value[c];
  }
}

void Renderer::RenderRow(std::span<const Rigid3> scene_from_camera, std::uint32_t frame, int row,
                         Scratch* scratch, std::uint8_t* bgr) const {
  const RaySoa& rays = rows_[row];
  Scratch& s = *scratch;
  if (scene_from_camera.size() == 1) {
    TransformRays(scene_from_camera[0], rays, &s.rays_in_scene);
  } else {
    const std::uint32_t seed = Hash(frame, static_cast<std::uint32_t>(row));
    TransformMovingRays(scene_from_camera, static_cast<std::uint32_t>(samples_), seed, rays,
                        &s.rays_in_scene);
  }
  caster_.Trace(s.rays_in_scene, s.hits);

  s.points.clear();
  s.sample_of_point.clear();
  const auto samples = static_cast<std::uint32_t>(samples_);
  for (std::uint32_t i = 0; i < rays.size(); ++i) {
    const RayHit& hit = s.hits[i];
    if (hit.range_m < 0.0f) continue;
    const RaySoa& r = s.rays_in_scene;
    const std::uint32_t sample = i % samples;
    SurfacePoint& point = s.points.emplace_back();
    point.position_in_scene =
        Vec3f(r.ox[i], r.oy[i], r.oz[i]) + hit.range_m * Vec3f(r.dx[i], r.dy[i], r.dz[i]);
    point.footprint_m = hit.range_m * sample_angle_rad_;
    point.lod_dither = (static_cast<float>(sample) + 0.5f) / static_cast<float>(samples);
    point.mesh = hit.mesh;
    point.triangle = hit.triangle;
    point.u = hit.u;
    point.v = hit.v;
    s.sample_of_point.push_back(i);
  }
  s.albedo.resize(s.points.size());
  scene_.Albedo(s.points, s.albedo);

  const Eigen::Matrix3f camera_from_scene = scene_from_camera[scene_from_camera.size() / 2]
                                                .rotation.conjugate()
                                                .toRotationMatrix()
                                                .cast<float>();
  const float share = 1.0f / static_cast<float>(samples_);
  std::size_t first_point = 0;
  for (int x = 0; x < camera_.width(); ++x) {
    const std::size_t first_sample = static_cast<std::size_t>(x) * samples_;
    std::size_t end_point = first_point;
    while (end_point < s.points.size() && s.sample_of_point[end_point] < first_sample + samples_)
      ++end_point;
    Rgb sum = {0.0f, 0.0f, 0.0f};
    ShadePixel(camera_from_scene, first_sample, first_point, end_point - first_point, rays, scratch,
               &sum);
    first_point = end_point;
    Develop({share * sum[0], share * sum[1], share * sum[2]}, x, row, frame, bgr + 3 * x);
  }
}

void Renderer::Render(std::span<const Rigid3> world_from_camera, std::uint32_t frame,
                      RenderedImage* image) const {
  const int width = camera_.width();
  Scratch scratch;
  const std::size_t samples = static_cast<std::size_t>(width) * samples_;
  scratch.rays_in_scene.Resize(samples);
  scratch.hits.resize(samples);
  scratch.points.reserve(samples);
  scratch.sample_of_point.reserve(samples);
  scratch.albedo.reserve(samples);
  image->width = width;
  image->height = camera_.height();
  image->bgr.resize(static_cast<std::size_t>(3) * width * camera_.height());
  std::vector<Rigid3> scene_from_camera(world_from_camera.begin(), world_from_camera.end());
  for (Rigid3& pose : scene_from_camera) pose.translation -= scene_.WorldOffset();
  for (int y = 0; y < camera_.height(); ++y) {
    RenderRow(scene_from_camera, frame, y, &scratch,
              &image->bgr[static_cast<std::size_t>(3) * width * y]);
  }
}

void Renderer::RenderRange(const Rigid3& world_from_camera, std::vector<float>* range_m) const {
  Rigid3 scene_from_camera = world_from_camera;
  scene_from_camera.translation -= scene_.WorldOffset();
  range_m->assign(static_cast<std::size_t>(camera_.width()) * camera_.height(), 0.0f);
  std::size_t i = 0;
  for (int y = 0; y < camera_.height(); ++y) {
    for (int x = 0; x < camera_.width(); ++x, ++i) {
      Ray3 ray;
      if (camera_.Backproject(Vec2(x + 0.5, y + 0.5), &ray) != Projection::kOk) continue;
      const Vec3 origin = scene_from_camera * ray.origin;
      const Vec3 direction = scene_from_camera.rotation * ray.direction;
      if (const auto hit = caster_.Trace(origin.cast<float>(), direction.cast<float>())) {
        (*range_m)[i] = hit->range_m;
      }
    }
  }
}

}  // namespace rsfm::simulator

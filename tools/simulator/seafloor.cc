#include "tools/simulator/seafloor.h"

#include <algorithm>
#include <cmath>

#include "rsfm/base/rng.h"
#include "tools/common/parallel.h"
#include "tools/simulator/noise.h"
#include "tools/simulator/stones.h"
#include "tools/simulator/texture.h"

namespace rsfm::simulator {
namespace {

constexpr int kDetailTexels = 4096;
constexpr float kDetailTexelM = 0.0011f;  // repeats after 4.5 m, beyond one image's reach
constexpr float kMaskTexelM = 0.05f;
constexpr std::size_t kMaxCells = 4'000'000;
constexpr double kMaxMacroTexels = 32e6;

float SmoothStep(float low, float high, float x) {
  const float t = std::clamp((x - low) / (high - low), 0.0f, 1.0f);
  return t * t * (3.0f - 2.0f * t);
}

// A tile of texture, divided by its mean when sampled: detail multiplies what it covers.
struct DetailTile {
  Texture texture;
  float inverse_texel_m = 1000.0f;
  float level_offset = 0.0f;
  float cosine = 1.0f;
  float sine = 0.0f;
  Float4 inverse_mean = {1.0f, 1.0f, 1.0f, 1.0f};

  void Finish(float texel_m, double angle) {
    inverse_texel_m = 1.0f / texel_m;
    level_offset = RoughLog2(inverse_texel_m);
    cosine = static_cast<float>(std::cos(angle));
    sine = static_cast<float>(std::sin(angle));
    texture.BuildMips();
    const Float4 mean = texture.Sample<Texture::Edge::kRepeat>(0.0f, 0.0f, 30.0f);
    for (int i = 0; i < 3; ++i) inverse_mean[i] = 1.0f / std::max(mean[i], 0.02f);
  }
  // `level` is the mip level of the footprint over one metre.
  Float4 Sample(float x, float y, float level) const {
    const float u = (cosine * x + sine * y) * inverse_texel_m;
    const float v = (cosine * y - sine * x) * inverse_texel_m;
    return inverse_mean * texture.Sample<Texture::Edge::kRepeat>(u, v, level + level_offset);
  }
};

Rgb ToRgb(const Float4& colour) {
  return {std::min(colour[0], 0.95f), std::min(colour[1], 0.95f), std::min(colour[2], 0.95f)};
}

class Seafloor final : public Scene {
 public:
  Seafloor(const SeafloorOptions& options, int num_threads)
      : options_(options), num_threads_(num_threads) {
    const Vec2 center = 0.5 * (options.min_ne_m + options.max_ne_m);
    offset_ = Vec3(center.x(), center.y(), options.depth_m);
    size_ = (options.max_ne_m - options.min_ne_m).cast<float>();
    seed_ = static_cast<std::uint32_t>(Rng(options.seed).Next());
    MakeDetail();
    MakeMask();
    MakeMacro();
    MakeGround();
    MakeStones();
  }

  std::span<const TriangleMesh> meshes() const override { return meshes_; }
  Vec3 WorldOffset() const override { return offset_; }

  void Albedo(std::span<const SurfacePoint> points, std::span<Rgb> albedo) const override {
    for (std::size_t i = 0; i < points.size(); ++i) {
      albedo[i] = points[i].mesh == 0 ? GroundAlbedo(points[i]) : StoneAlbedo(points[i]);
    }
  }

 private:
  float Height(float x, float y) const {
    const float s = 1.0f / static_cast<float>(options_.relief_length_m);
    float height =
        options_.grid
            ? static_cast<float>(options_.grid->At(x + offset_.x(), y + offset_.y()))
            : static_cast<float>(options_.relief_m) * FractalNoise(s * x, s * y, 6, 0.42f, seed_);
    if (options_.ripple_height_m > 0.0) {
      const float warp = 0.35f * FractalNoise(0.6f * x, 0.6f * y, 2, 0.5f, seed_ + 1);
      const float phase = 2.0f * std::numbers::pi_v<float> * (x + 0.35f * y + warp) /
                          static_cast<float>(options_.ripple_length_m);
      const float strength = SmoothStep(-0.2f, 0.4f, GradientNoise(0.3f * x, 0.3f * y, seed_ + 2));
      height += 0.5f * static_cast<float>(options_.ripple_height_m) * strength *
                (std::sin(phase) + 0.3f * std::sin(2.0f * phase));
    }
    return height;
  }

  // Stones' and ground's own frame of texture: metres from the area's minimum corner.
  Vec2 AreaFromScene(float x, float y) const {
    return Vec2(x + 0.5 * size_.x(), y + 0.5 * size_.y());
  }

  void MakeDetail() {
    detail_.texture =
        Texture(kDetailTexels, kDetailTexels, Texture::Edge::kRepeat, {0.34f, 0.31f, 0.26f});
    PaintPebbles({130000, 1.6f, 16.0f, 1.8f, 0.8f, seed_ + 10}, num_threads_, &detail_.texture);
    PaintTiledNoise({32, 7, 0.8f, 0.22f, seed_ + 11}, num_threads_, &detail_.texture);
    detail_.Finish(kDetailTexelM, 0.4);
  }

  // Above it lies the given fraction of the values.
  static float Threshold(std::vector<float> values, double fraction) {
    if (fraction <= 0.0) return 1e9f;
    std::sort(values.begin(), values.end());
    const double rank = (1.0 - fraction) * static_cast<double>(values.size() - 1);
    return values[static_cast<std::size_t>(std::max(0.0, rank))];
  }

  // Red: contrast, 0 in the poor patches. Green: where the texture repeats.
  void MakeMask() {
    const int width = static_cast<int>(size_.x() / kMaskTexelM) + 2;
    const int height = static_cast<int>(size_.y() / kMaskTexelM) + 2;
    mask_ = Texture(width, height, Texture::Edge::kClamp, {0.0f, 0.0f, 0.0f});
    std::vector<float> poor, repeat;
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        const float north = 0.45f * kMaskTexelM * static_cast<float>(x);
        const float east = 0.45f * kMaskTexelM * static_cast<float>(y);
        poor.push_back(FractalNoise(north, east, 3, 0.5f, seed_ + 20));
        repeat.push_back(FractalNoise(north, east, 3, 0.5f, seed_ + 21));
      }
    }
    const float poor_above = Threshold(poor, options_.poor_fraction);
    const float repeat_above = Threshold(repeat, options_.repeat_fraction);
    std::size_t i = 0;
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x, ++i) {
        const float contrast = 1.0f - SmoothStep(poor_above - 0.03f, poor_above + 0.03f, poor[i]);
        mask_.Blend(x, y, {contrast, repeat[i] > repeat_above ? 1.0f : 0.0f, 0.0f}, 1.0f);
      }
    }
  }

  // Unique over the whole area: tints, mottling and pebbles of centimetres. The fourth channel is
  // the contrast of the finer detail.
  void MakeMacro() {
    const double area_m2 = static_cast<double>(size_.x()) * size_.y();
    macro_texel_m_ = static_cast<float>(std::max(0.005, std::sqrt(area_m2 / kMaxMacroTexels)));
    const int width = static_cast<int>(size_.x() / macro_texel_m_) + 2;
    const int height = static_cast<int>(size_.y() / macro_texel_m_) + 2;
    macro_ = Texture(width, height, Texture::Edge::kClamp, {0.40f, 0.37f, 0.31f});
    const float min_radius = std::max(0.006f / macro_texel_m_, 0.8f);
    const float max_radius = std::max(0.10f / macro_texel_m_, 2.0f);
    PaintPebbles(
        {static_cast<int>(area_m2 * 260.0), min_radius, max_radius, 1.7f, 0.9f, seed_ + 30},
        num_threads_, &macro_);
    ParallelFor(height, num_threads_, [&](int y) {
      for (int x = 0; x < width; ++x) {
        const float north = macro_texel_m_ * static_cast<float>(x);
        const float east = macro_texel_m_ * static_cast<float>(y);
        const float contrast = MaskAt(north, east)[0];
        macro_.Blend(x, y, {0.46f, 0.42f, 0.34f}, 0.96f * (1.0f - contrast));
        const float strength = 0.30f * (0.15f + 0.85f * contrast);
        const float mottle =
            1.0f + strength * FractalNoise(0.8f * north, 0.8f * east, 6, 0.72f, seed_ + 31);
        const float hue = 0.12f * GradientNoise(0.23f * north, 0.23f * east, seed_ + 32);
        macro_.Multiply(x, y, {mottle * (1.0f + hue), mottle, mottle * (1.0f - hue)});
        macro_.SetFourth(x, y, 0.10f + 0.90f * contrast);
      }
    });
    macro_.BuildMips();
    macro_level_offset_ = RoughLog2(1.0f / macro_texel_m_);
  }

  void MakeGround() {
    const double cells =
        static_cast<double>(size_.x()) * size_.y() / (options_.cell_m * options_.cell_m);
    const double cell =
        options_.cell_m * std::max(1.0, std::sqrt(cells / static_cast<double>(kMaxCells)));
    const auto nx = static_cast<std::uint32_t>(std::ceil(size_.x() / cell)) + 1;
    const auto ny = static_cast<std::uint32_t>(std::ceil(size_.y() / cell)) + 1;
    TriangleMesh& mesh = meshes_.emplace_back();
    mesh.vertices.reserve(static_cast<std::size_t>(nx) * ny);
    mesh.triangles.reserve(2 * static_cast<std::size_t>(nx) * ny);
    for (std::uint32_t j = 0; j < ny; ++j) {
      for (std::uint32_t i = 0; i < nx; ++i) {
        const float x = -0.5f * size_.x() + static_cast<float>(i) * static_cast<float>(cell);
        const float y = -0.5f * size_.y() + static_cast<float>(j) * static_cast<float>(cell);
        mesh.vertices.emplace_back(x, y, -Height(x, y));
      }
    }
    // Up is -z: seen from above, (x east of y) turns so that the normals point up.
    for (std::uint32_t j = 0; j + 1 < ny; ++j) {
      for (std::uint32_t i = 0; i + 1 < nx; ++i) {
        const std::uint32_t a = j * nx + i;
        mesh.triangles.push_back({a, a + nx, a + 1});
        mesh.triangles.push_back({a + 1, a + nx, a + nx + 1});
      }
    }
    ComputeNormals(&mesh);
  }

  void MakeStones() {
    Rng rng(options_.seed ^ 0x53544F4E45u);
    const auto count = static_cast<int>(options_.stones_per_m2 * size_.x() * size_.y());
    const TriangleMesh spheres[2] = {MakeIcosphere(2), MakeIcosphere(3)};
    TriangleMesh meshes[2];
    const double ratio = std::pow(options_.stone_max_radius_m / options_.stone_min_radius_m, -1.6);
    for (int i = 0; i < count; ++i) {
      Stone stone;
      const auto x = static_cast<float>(rng.Uniform(-0.5, 0.5)) * size_.x();
      const auto y = static_cast<float>(rng.Uniform(-0.5, 0.5)) * size_.y();
      stone.radius_m = static_cast<float>(
          options_.stone_min_radius_m * std::pow(1.0 - rng.Uniform() * (1.0 - ratio), -1.0 / 1.6));
      const auto sunk = static_cast<float>(rng.Uniform(-0.1, 0.45));
      stone.center_in_scene = Vec3f(x, y, -Height(x, y) + (sunk - 0.1f) * stone.radius_m);
      const auto tone = static_cast<float>(rng.Uniform(0.35, 1.3));
      const auto hue = static_cast<float>(rng.Uniform(-0.12, 0.15));
      stone.tint = {0.36f * tone * (1.0f + hue), 0.34f * tone, 0.31f * tone * (1.0f - hue)};
      stone.texture_offset_m = Vec2(rng.Uniform(0.0, 50.0), rng.Uniform(0.0, 50.0));
      Rng shape(rng.Next());
      const Vec2 area = AreaFromScene(x, y);
      if (MaskAt(static_cast<float>(area.x()), static_cast<float>(area.y()))[0] < 0.5f) continue;
      const int size = stone.radius_m > 0.12f ? 1 : 0;
      AppendStone(spheres[size], stone, &shape, &meshes[size]);
      stones_[size].push_back(stone);
    }
    for (int size = 0; size < 2; ++size) {
      triangles_per_stone_[size] = static_cast<std::uint32_t>(spheres[size].triangles.size());
      ComputeNormals(&meshes[size]);
      meshes_.push_back(std::move(meshes[size]));
    }
  }

  Float4 MaskAt(float north, float east) const {
    return mask_.Sample<Texture::Edge::kClamp>(north / kMaskTexelM, east / kMaskTexelM, 0.0f);
  }

  Rgb GroundAlbedo(const SurfacePoint& point) const {
    float x = point.position_in_scene.x() + 0.5f * size_.x();
    float y = point.position_in_scene.y() + 0.5f * size_.y();
    if (options_.repeat_fraction > 0.0 && MaskAt(x, y)[1] > 0.5f) {
      const auto period = static_cast<float>(options_.repeat_length_m);
      x = std::fmod(x, period);
      y = std::fmod(y, period);
    }
    const float level = RoughLog2(point.footprint_m) + point.lod_dither;
    const float inverse = 1.0f / macro_texel_m_;
    const Float4 macro =
        macro_.Sample<Texture::Edge::kClamp>(x * inverse, y * inverse, level + macro_level_offset_);
    const Float4 detail = detail_.Sample(x, y, level);
    return ToRgb(macro * (1.0f + macro[3] * (detail - 1.0f)));
  }

  // Projected along one oblique direction, at two scales: no seams, and no face that is seen from
  // above is stretched much.
  Rgb StoneAlbedo(const SurfacePoint& point) const {
    constexpr float kCoarse = 0.27f;
    const std::uint32_t size = point.mesh - 1;
    const Stone& stone = stones_[size][point.triangle / triangles_per_stone_[size]];
    const Vec3f local = point.position_in_scene - stone.center_in_scene;
    const float u = local.x() + 0.6f * local.z() + static_cast<float>(stone.texture_offset_m.x());
    const float v = local.y() - 0.8f * local.z() + static_cast<float>(stone.texture_offset_m.y());
    const float level = RoughLog2(point.footprint_m) + point.lod_dither;
    const Float4 fine = 0.20f + 0.80f * detail_.Sample(u, v, level);
    const Float4 coarse =
        0.30f + 0.70f * detail_.Sample(kCoarse * u + 7.0f, kCoarse * v, level + RoughLog2(kCoarse));
    const Float4 tint = {stone.tint[0], stone.tint[1], stone.tint[2], 1.0f};
    return ToRgb(tint * fine * coarse);
  }

  SeafloorOptions options_;
  int num_threads_;
  Vec3 offset_ = Vec3::Zero();
  Eigen::Vector2f size_ = Eigen::Vector2f::Zero();
  std::uint32_t seed_ = 0;
  DetailTile detail_;
  Texture mask_;
  Texture macro_;
  float macro_texel_m_ = 0.01f;
  float macro_level_offset_ = 0.0f;
  std::vector<TriangleMesh> meshes_;  // ground, small stones, large stones
  std::vector<Stone> stones_[2];
  std::uint32_t triangles_per_stone_[2] = {1, 1};
};

}  // namespace

std::unique_ptr<Scene> MakeSeafloor(const SeafloorOptions& options, int num_threads) {
  return std::make_unique<Seafloor>(options, num_threads);
}

}  // namespace rsfm::simulator

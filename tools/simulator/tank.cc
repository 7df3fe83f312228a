#include "tools/simulator/tank.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "rsfm/base/rng.h"
#include "rsfm/base/so3.h"
#include "tools/common/parallel.h"
#include "tools/simulator/noise.h"
#include "tools/simulator/stones.h"
#include "tools/simulator/textured_scene.h"

namespace rsfm::simulator {
namespace {

using Vec2f = Eigen::Vector2f;

constexpr float kFloorCellM = 0.01f;
constexpr float kWallCellM = 0.05f;
constexpr float kSkyFloor = 0.30f;
constexpr float kSkyReachM = 0.45f;

// Stones of all sizes and mottling over a texture of `texel_m`.
struct Paint {
  float pebbles_per_m2 = 20000.0f;
  float min_radius_m = 0.0012f;
  float max_radius_m = 0.04f;
  float opacity = 0.95f;
  float mottle = 0.35f;
};

void PaintTexture(const Paint& paint, float texel_m, float contrast, std::uint32_t seed,
                  int num_threads, Texture* texture) {
  const float area_m2 = texel_m * texel_m * static_cast<float>(texture->width()) *
                        static_cast<float>(texture->height());
  PebbleStyle style;
  style.count = static_cast<int>(paint.pebbles_per_m2 * area_m2);
  style.min_radius_px = std::max(1.2f, paint.min_radius_m / texel_m);
  style.max_radius_px = std::max(2.0f * style.min_radius_px, paint.max_radius_m / texel_m);
  style.exponent = 1.7f;
  style.opacity = paint.opacity * contrast;
  style.seed = seed;
  PaintPebbles(style, num_threads, texture);
  const float coarse = texel_m * 9.0f;
  ParallelFor(texture->height(), num_threads, [&](int y) {
    for (int x = 0; x < texture->width(); ++x) {
      const float u = coarse * static_cast<float>(x);
      const float v = coarse * static_cast<float>(y);
      const float mottle = 1.0f + contrast * paint.mottle * FractalNoise(u, v, 6, 0.75f, seed + 1);
      const float hue = 0.15f * GradientNoise(0.4f * u, 0.4f * v, seed + 2);
      const float level = std::max(0.1f, mottle);
      texture->Multiply(x, y, {level * (1.0f + hue), level, level * (1.0f - hue)});
    }
  });
  texture->BuildMips();
}

// Places rectangles in a texture of fixed width, row by row.
class Shelves {
 public:
  explicit Shelves(int width) : width_(width) {}

  // The corner of a free rectangle, texels.
  Vec2f Place(const Vec2f& size) {
    const int w = static_cast<int>(std::ceil(size.x())) + 4;
    const int h = static_cast<int>(std::ceil(size.y())) + 4;
    if (x_ + w > width_) {
      y_ += row_;
      x_ = row_ = 0;
    }
    const Vec2f corner(static_cast<float>(x_ + 2), static_cast<float>(y_ + 2));
    x_ += w;
    row_ = std::max(row_, h);
    return corner;
  }
  int height() const { return y_ + row_; }

 private:
  int width_;
  int x_ = 0;
  int y_ = 0;
  int row_ = 0;
};

class TankBuilder {
 public:
  TankBuilder(const TankOptions& options, int num_threads)
      : options_(options),
        num_threads_(num_threads),
        half_length_(0.5f * static_cast<float>(options.length_m)),
        half_width_(0.5f * static_cast<float>(options.width_m)),
        height_(static_cast<float>(options.height_m)),
        texel_m_(static_cast<float>(options.texel_m)),
        seed_(static_cast<std::uint32_t>(Rng(options.seed).Next())),
        rng_(options.seed ^ 0x54414E4Bu) {}

  std::unique_ptr<Scene> Build() {
    MakeFloor();
    MakeWalls();
    MakeObjects();
    BakeSkyLight(kSkyFloor, kSkyReachM, num_threads_, &meshes_);
    return std::make_unique<TexturedScene>(std::move(meshes_), std::move(textures_),
                                           Vec3(0.0, 0.0, options_.depth_m));
  }

 private:
  float FloorHeight(float x, float y) const {
    return static_cast<float>(options_.relief_m) *
           FractalNoise(2.2f * x + 11.0f, 2.2f * y, 5, 0.45f, seed_ + 1);
  }

  // A grid of nu x nv cells over the unit square: `place` and `texel` say where its points lie.
  template <class Place, class Texel>
  void AddGrid(int nu, int nv, float texels_per_m, int texture, bool flip, const Place& place,
               const Texel& texel) {
    TexturedMesh& out = meshes_.emplace_back();
    out.texture = texture;
    const auto share = [](int k, int n) { return static_cast<float>(k) / static_cast<float>(n); };
    for (int j = 0; j <= nv; ++j) {
      for (int i = 0; i <= nu; ++i) {
        out.mesh.vertices.push_back(place(share(i, nu), share(j, nv)));
      }
    }
    const auto add = [&](int i, int j, const std::array<std::array<int, 2>, 3>& corners) {
      std::array<std::uint32_t, 3> triangle;
      std::array<Vec2f, 3> uv;
      for (int k = 0; k < 3; ++k) {
        const int a = i + corners[k][0];
        const int b = j + corners[k][1];
        triangle[k] = static_cast<std::uint32_t>(b * (nu + 1) + a);
        uv[k] = texel(share(a, nu), share(b, nv));
      }
      if (flip) {
        std::swap(triangle[1], triangle[2]);
        std::swap(uv[1], uv[2]);
      }
      out.mesh.triangles.push_back(triangle);
      out.corner_uv.push_back(uv);
    };
    for (int j = 0; j < nv; ++j) {
      for (int i = 0; i < nu; ++i) {
        add(i, j, {{{0, 0}, {0, 1}, {1, 0}}});
        add(i, j, {{{1, 0}, {0, 1}, {1, 1}}});
      }
    }
    out.texels_per_m.assign(out.mesh.triangles.size(), texels_per_m);
    ComputeNormals(&out.mesh);
  }

  int AddTexture(float width_m, float height_m, const Rgb& base, const Paint& paint,
                 std::uint32_t seed) {
    textures_.emplace_back(static_cast<int>(width_m / texel_m_) + 2,
                           static_cast<int>(height_m / texel_m_) + 2, Texture::Edge::kClamp, base);
    PaintTexture(paint, texel_m_, static_cast<float>(options_.contrast), seed, num_threads_,
                 &textures_.back());
    return static_cast<int>(textures_.size()) - 1;
  }

  void MakeFloor() {
    const float length = 2.0f * half_length_;
    const float width = 2.0f * half_width_;
    const int texture = AddTexture(length, width, {0.42f, 0.38f, 0.31f}, {}, seed_ + 10);
    const float per_m = 1.0f / texel_m_;
    AddGrid(
        std::max(1, static_cast<int>(length / kFloorCellM)),
        std::max(1, static_cast<int>(width / kFloorCellM)), per_m, texture, false,
        [&](float u, float v) {
          const float x = -half_length_ + u * length;
          const float y = -half_width_ + v * width;
          return Vec3f(x, y, -FloorHeight(x, y));
        },
        [&](float u, float v) { return Vec2f(u * length * per_m, v * width * per_m); });
  }

  // One strip of texture around the tank: no wall is like another.
  void MakeWalls() {
    const float sides[4] = {2.0f * half_length_, 2.0f * half_width_, 2.0f * half_length_,
                            2.0f * half_width_};
    // From below the gravel, so that no gap shows.
    const float low = 2.0f * static_cast<float>(options_.relief_m);
    const float rise = height_ + low;
    Paint paint;
    paint.pebbles_per_m2 = 7000.0f;
    paint.min_radius_m = 0.0018f;
    paint.max_radius_m = 0.07f;
    paint.mottle = 0.45f;
    const int texture = AddTexture(sides[0] + sides[1] + sides[2] + sides[3], rise,
                                   {0.45f, 0.52f, 0.55f}, paint, seed_ + 20);
    const Vec2f corners[5] = {{-half_length_, -half_width_},
                              {half_length_, -half_width_},
                              {half_length_, half_width_},
                              {-half_length_, half_width_},
                              {-half_length_, -half_width_}};
    const float per_m = 1.0f / texel_m_;
    float start = 0.0f;
    for (int side = 0; side < 4; ++side) {
      const Vec2f from = corners[side];
      const Vec2f to = corners[side + 1];
      AddGrid(
          std::max(1, static_cast<int>(sides[side] / kWallCellM)),
          std::max(1, static_cast<int>(rise / kWallCellM)), per_m, texture, true,
          [&](float u, float v) {
            const Vec2f place = from + u * (to - from);
            return Vec3f(place.x(), place.y(), low - v * rise);
          },
          [&](float u, float v) {
            return Vec2f((start + u * sides[side]) * per_m, (1.0f - v) * rise * per_m);
          });
      start += sides[side];
    }
  }

  // Where things stand: not too near to each other, nor to a wall.
  Vec2f FreePlace(float radius) {
    Vec2f place = Vec2f::Zero();
    for (int attempt = 0; attempt < 200; ++attempt) {
      const float reach_x = std::max(0.0f, half_length_ - 1.1f * radius);
      const float reach_y = std::max(0.0f, half_width_ - 1.1f * radius);
      place = Vec2f(static_cast<float>(rng_.Uniform(-1.0, 1.0)) * reach_x,
                    static_cast<float>(rng_.Uniform(-1.0, 1.0)) * reach_y);
      bool is_free = true;
      for (const auto& [other, other_radius] : taken_) {
        is_free &= (place - other).norm() > 0.8f * (radius + other_radius);
      }
      if (is_free) break;
    }
    taken_.push_back({place, radius});
    return place;
  }

  Rgb Tint() {
    const auto tone = static_cast<float>(rng_.Uniform(0.65, 1.25));
    const auto hue = static_cast<float>(rng_.Uniform(-0.2, 0.2));
    return {tone * (1.0f + hue), tone, tone * (1.0f - hue)};
  }

  // Gives each face the chart of the axis that it looks along; charts lie apart in the texture.
  void AddObject(TriangleMesh mesh) {
    TexturedMesh out;
    Vec3f low = mesh.vertices.front();
    Vec3f high = low;
    for (const Vec3f& vertex : mesh.vertices) {
      low = low.cwiseMin(vertex);
      high = high.cwiseMax(vertex);
    }
    const Vec3f size = high - low;
    const float per_m = 1.0f / texel_m_;
    Vec2f chart[6];
    for (int i = 0; i < 6; ++i) {
      const int a = (i / 2 + 1) % 3;
      const int b = (i / 2 + 2) % 3;
      chart[i] = shelves_.Place(Vec2f(size[a], size[b]) * per_m);
    }
    for (const auto& triangle : mesh.triangles) {
      const Vec3f& origin = mesh.vertices[triangle[0]];
      const Vec3f normal = (mesh.vertices[triangle[1]] - origin)
                               .cross(mesh.vertices[triangle[2]] - origin)
                               .normalized();
      int axis = 0;
      normal.cwiseAbs().maxCoeff(&axis);
      const Vec2f& corner = chart[2 * axis + (normal[axis] > 0.0f ? 1 : 0)];
      std::array<Vec2f, 3> uv;
      for (int k = 0; k < 3; ++k) {
        const Vec3f local = (mesh.vertices[triangle[k]] - low) * per_m;
        uv[k] = corner + Vec2f(local[(axis + 1) % 3], local[(axis + 2) % 3]);
      }
      out.corner_uv.push_back(uv);
    }
    out.texels_per_m.assign(mesh.triangles.size(), per_m);
    out.tint.assign(mesh.vertices.size(), Tint());
    ComputeNormals(&mesh);
    out.mesh = std::move(mesh);
    objects_.push_back(std::move(out));
  }

  void AddStone() {
    Stone stone;
    stone.radius_m = static_cast<float>(rng_.Uniform(0.05, 0.15));
    const Vec2f place = FreePlace(stone.radius_m);
    const auto sunk = static_cast<float>(rng_.Uniform(0.0, 0.35));
    stone.center_in_scene = Vec3f(
        place.x(), place.y(), -FloorHeight(place.x(), place.y()) - (0.45f - sunk) * stone.radius_m);
    TriangleMesh mesh;
    Rng shape(rng_.Next());
    AppendStone(sphere_, stone, &shape, &mesh);
    AddObject(std::move(mesh));
  }

  // A box of flat faces with corners of their own, so that normals do not blend over the edges.
  void AddBrick() {
    const Vec3f half(static_cast<float>(rng_.Uniform(0.05, 0.12)),
                     static_cast<float>(rng_.Uniform(0.03, 0.07)),
                     static_cast<float>(rng_.Uniform(0.03, 0.14)));
    const Vec2f place = FreePlace(half.head<2>().norm());
    const Quat turn =
        ExpSo3(Vec3(rng_.Uniform(-0.25, 0.25), rng_.Uniform(-0.25, 0.25), rng_.Uniform(-3.1, 3.1)));
    const Vec3f center(place.x(), place.y(), -FloorHeight(place.x(), place.y()) - 0.75f * half.z());
    TriangleMesh mesh;
    constexpr int kCells = 8;
    for (int axis = 0; axis < 3; ++axis) {
      for (const float sign : {-1.0f, 1.0f}) {
        const auto first = static_cast<std::uint32_t>(mesh.vertices.size());
        for (int j = 0; j <= kCells; ++j) {
          for (int i = 0; i <= kCells; ++i) {
            Vec3f p;
            p[axis] = sign;
            p[(axis + 1) % 3] = 2.0f * static_cast<float>(i) / kCells - 1.0f;
            p[(axis + 2) % 3] = sign * (2.0f * static_cast<float>(j) / kCells - 1.0f);
            mesh.vertices.push_back(center + turn.cast<float>() * p.cwiseProduct(half));
          }
        }
        for (std::uint32_t j = 0; j < kCells; ++j) {
          for (std::uint32_t i = 0; i < kCells; ++i) {
            const std::uint32_t a = first + j * (kCells + 1) + i;
            mesh.triangles.push_back({a, a + 1, a + kCells + 1});
            mesh.triangles.push_back({a + 1, a + kCells + 2, a + kCells + 1});
          }
        }
      }
    }
    AddObject(std::move(mesh));
  }

  void AddPost() {
    constexpr std::uint32_t kAround = 40;
    constexpr std::uint32_t kUp = 12;
    const auto radius = static_cast<float>(rng_.Uniform(0.025, 0.06));
    const auto height = static_cast<float>(rng_.Uniform(0.10, 0.34));
    const Vec2f place = FreePlace(radius);
    const float foot = -FloorHeight(place.x(), place.y()) + 0.02f;
    TriangleMesh mesh;
    const auto rim = [&](std::uint32_t i, float z) {
      const float angle = 2.0f * std::numbers::pi_v<float> * static_cast<float>(i) / kAround;
      return Vec3f(place.x() + radius * std::cos(angle), place.y() + radius * std::sin(angle), z);
    };
    for (std::uint32_t j = 0; j <= kUp; ++j) {
      for (std::uint32_t i = 0; i < kAround; ++i) {
        mesh.vertices.push_back(rim(i, foot - height * static_cast<float>(j) / kUp));
      }
    }
    for (std::uint32_t j = 0; j < kUp; ++j) {
      for (std::uint32_t i = 0; i < kAround; ++i) {
        const std::uint32_t next = (i + 1) % kAround;
        const std::uint32_t a = j * kAround + i;
        const std::uint32_t b = j * kAround + next;
        mesh.triangles.push_back({a, a + kAround, b});
        mesh.triangles.push_back({b, a + kAround, b + kAround});
      }
    }
    const auto top = static_cast<std::uint32_t>(mesh.vertices.size());
    mesh.vertices.emplace_back(place.x(), place.y(), foot - height);
    for (std::uint32_t i = 0; i < kAround; ++i) mesh.vertices.push_back(rim(i, foot - height));
    for (std::uint32_t i = 0; i < kAround; ++i) {
      mesh.triangles.push_back({top, top + 1 + (i + 1) % kAround, top + 1 + i});
    }
    AddObject(std::move(mesh));
  }

  void MakeObjects() {
    for (int i = 0; i < options_.bricks; ++i) AddBrick();
    for (int i = 0; i < options_.posts; ++i) AddPost();
    for (int i = 0; i < options_.stones; ++i) AddStone();
    if (objects_.empty()) return;
    Paint paint;
    paint.pebbles_per_m2 = 24000.0f;
    paint.max_radius_m = 0.02f;
    paint.mottle = 0.5f;
    const int texture = AddTexture(kShelfM, static_cast<float>(shelves_.height()) * texel_m_,
                                   {0.50f, 0.44f, 0.38f}, paint, seed_ + 30);
    for (TexturedMesh& object : objects_) {
      object.texture = texture;
      meshes_.push_back(std::move(object));
    }
  }

  static constexpr float kShelfM = 2.4f;  // width of the objects' texture

  TankOptions options_;
  int num_threads_;
  float half_length_, half_width_, height_, texel_m_;
  std::uint32_t seed_;
  Rng rng_;
  TriangleMesh sphere_ = MakeIcosphere(4);
  Shelves shelves_{static_cast<int>(kShelfM / texel_m_)};
  std::vector<std::pair<Vec2f, float>> taken_;
  std::vector<TexturedMesh> objects_;
  std::vector<TexturedMesh> meshes_;
  std::vector<Texture> textures_;
};

}  // namespace

std::unique_ptr<Scene> MakeTank(const TankOptions& options, int num_threads) {
  return TankBuilder(options, num_threads).Build();
}

}  // namespace rsfm::simulator

#include "tools/simulator/mesh_scene.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/core/mat.hpp>
#include <opencv2/imgcodecs.hpp>
#include <utility>

#include "rsfm/io/atomic_output.h"
#include "tools/common/ply.h"
#include "tools/simulator/textured_scene.h"

namespace rsfm::simulator {
namespace {

using Vec2f = Eigen::Vector2f;

constexpr float kSkyReachM = 2.0f;
constexpr int kGeneratedTexels = 4096;
constexpr float kGeneratedTexelM = 0.0011f;

float LinearFromSrgb(int value) {
  const double v = value / 255.0;
  return static_cast<float>(v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4));
}

IoExpected<Texture> ReadTexture(const std::filesystem::path& path) {
  const auto bytes = ReadWholeFile(path);
  if (!bytes) return Fail(bytes.error());
  const cv::Mat encoded(1, static_cast<int>(bytes->size()), CV_8UC1,
                        const_cast<char*>(bytes->data()));
  const cv::Mat image = bytes->empty() ? cv::Mat() : cv::imdecode(encoded, cv::IMREAD_COLOR);
  if (image.empty()) {
    return Fail({Errc::kCorrupt, path.string(), "", "is no image that can be read",
                 "give a PNG, JPEG or TIFF"});
  }
  float linear[256];
  for (int i = 0; i < 256; ++i) linear[i] = LinearFromSrgb(i);
  Texture texture(image.cols, image.rows, Texture::Edge::kClamp, {0.0f, 0.0f, 0.0f});
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      const cv::Vec3b& bgr = image.at<cv::Vec3b>(y, x);
      texture.Blend(x, y, {linear[bgr[2]], linear[bgr[1]], linear[bgr[0]]}, 1.0f);
    }
  }
  texture.BuildMips();
  return texture;
}

Texture GeneratedTexture(std::uint32_t seed, int num_threads) {
  Texture texture(kGeneratedTexels, kGeneratedTexels, Texture::Edge::kRepeat,
                  {0.36f, 0.33f, 0.28f});
  PaintPebbles({130000, 1.6f, 24.0f, 1.8f, 0.85f, seed}, num_threads, &texture);
  PaintTiledNoise({32, 7, 0.8f, 0.25f, seed + 1}, num_threads, &texture);
  texture.BuildMips();
  return texture;
}

std::vector<Vec3> WorldVertices(const PlyMesh& mesh, bool z_is_up) {
  std::vector<Vec3> vertices = mesh.vertices;
  if (z_is_up) {
    for (Vec3& v : vertices) v = Vec3(v.y(), v.x(), -v.z());
  }
  return vertices;
}

// Square root of the ratio of a triangle's areas in the texture and in the scene.
float Density(const std::array<Vec2f, 3>& uv, const Vec3f& a, const Vec3f& b, const Vec3f& c) {
  const Vec2f p = uv[1] - uv[0];
  const Vec2f q = uv[2] - uv[0];
  const float texels = std::abs(p.x() * q.y() - p.y() * q.x());
  const float metres = (b - a).cross(c - a).norm();
  return std::sqrt(std::max(texels, 1e-9f) / std::max(metres, 1e-12f));
}

class Builder {
 public:
  Builder(const MeshOptions& options, PlyMesh mesh) : options_(options), ply_(std::move(mesh)) {
    const std::vector<Vec3> vertices = WorldVertices(ply_, options.z_is_up);
    low_ = high_ = vertices.front();
    for (const Vec3& v : vertices) {
      low_ = low_.cwiseMin(v);
      high_ = high_.cwiseMax(v);
    }
    offset_ = 0.5 * (low_ + high_);
    for (const Vec3& v : vertices) out_.mesh.vertices.push_back((v - offset_).cast<float>());
    for (const auto& [a, b, c] : ply_.triangles) {
      out_.mesh.triangles.push_back({static_cast<std::uint32_t>(a), static_cast<std::uint32_t>(b),
                                     static_cast<std::uint32_t>(c)});
    }
    ComputeNormals(&out_.mesh);
    for (Vec3f& normal : out_.mesh.normals) {
      if (!normal.allFinite()) normal = -Vec3f::UnitZ();  // of triangles without an area
    }
  }

  IoExpected<std::unique_ptr<Scene>> Build(int num_threads) {
    std::vector<Texture> textures;
    if (!options_.texture.empty()) {
      auto texture = ReadTexture(options_.texture);
      if (!texture) return Fail(texture.error());
      ply_.corner_texcoords.empty() ? LayFromAbove(*texture) : LayAsTold(*texture);
      textures.push_back(std::move(*texture));
    } else if (!ply_.colours.empty()) {
      for (const auto& c : ply_.colours) {
        Rgb& tint = out_.tint.emplace_back();
        for (int i = 0; i < 3; ++i) {
          tint[i] = LinearFromSrgb(static_cast<int>(std::clamp(c[i], 0.0, 1.0) * 255.0 + 0.5));
        }
      }
    } else {
      LayGenerated();
      textures.push_back(
          GeneratedTexture(static_cast<std::uint32_t>(options_.seed) + 77u, num_threads));
    }
    if (!textures.empty()) out_.texture = 0;
    std::vector<TexturedMesh> meshes;
    meshes.push_back(std::move(out_));
    if (options_.sky_light > 0.0) {
      BakeSkyLight(static_cast<float>(1.0 - options_.sky_light), kSkyReachM, num_threads, &meshes);
    }
    return std::make_unique<TexturedScene>(std::move(meshes), std::move(textures), offset_);
  }

 private:
  // Texel positions of triangle i from texel_of(corner index, vertex).
  template <class TexelOf>
  void Lay(const TexelOf& texel_of) {
    for (std::size_t i = 0; i < out_.mesh.triangles.size(); ++i) {
      const auto& triangle = out_.mesh.triangles[i];
      std::array<Vec2f, 3> uv;
      for (std::size_t k = 0; k < 3; ++k) uv[k] = texel_of(i, k, out_.mesh.vertices[triangle[k]]);
      out_.texels_per_m.push_back(Density(uv, out_.mesh.vertices[triangle[0]],
                                          out_.mesh.vertices[triangle[1]],
                                          out_.mesh.vertices[triangle[2]]));
      out_.corner_uv.push_back(uv);
    }
  }

  void LayAsTold(const Texture& texture) {
    const auto width = static_cast<float>(texture.width());
    const auto height = static_cast<float>(texture.height());
    Lay([&](std::size_t i, std::size_t k, const Vec3f&) {
      const Vec2f t = ply_.corner_texcoords[i][k].cast<float>();
      return Vec2f(t.x() * width, (1.0f - t.y()) * height);
    });
  }

  void LayFromAbove(const Texture& texture) {
    const Vec3f size = (high_ - low_).cast<float>();
    const float per_east = static_cast<float>(texture.width()) / std::max(size.y(), 1e-6f);
    const float per_north = static_cast<float>(texture.height()) / std::max(size.x(), 1e-6f);
    Lay([&](std::size_t, std::size_t, const Vec3f& p) {
      return Vec2f((p.y() + 0.5f * size.y()) * per_east, (0.5f * size.x() - p.x()) * per_north);
    });
  }

  // Along the axis that the triangle looks along.
  void LayGenerated() {
    const auto& mesh = out_.mesh;
    Lay([&](std::size_t i, std::size_t, const Vec3f& p) {
      const auto& [a, b, c] = mesh.triangles[i];
      int axis = 0;
      (mesh.vertices[b] - mesh.vertices[a])
          .cross(mesh.vertices[c] - mesh.vertices[a])
          .cwiseAbs()
          .maxCoeff(&axis);
      return Vec2f(p[(axis + 1) % 3] / kGeneratedTexelM + 1000.0f * static_cast<float>(axis),
                   p[(axis + 2) % 3] / kGeneratedTexelM);
    });
  }

  const MeshOptions& options_;
  PlyMesh ply_;
  Vec3 low_, high_, offset_;
  TexturedMesh out_;
};

IoExpected<PlyMesh> Read(const MeshOptions& options) {
  auto mesh = ReadPlyMesh(options.file);
  if (!mesh) return mesh;
  for (const Vec3& vertex : mesh->vertices) {
    if (vertex.cwiseAbs().maxCoeff() < 1e6) continue;
    return Fail({Errc::kInvalidArgument, options.file.string(), "", "lies farther than 1000 km off",
                 "give metres, about an origin near the mesh"});
  }
  return mesh;
}

}  // namespace

IoExpected<std::unique_ptr<Scene>> LoadMeshScene(const MeshOptions& options, int num_threads) {
  auto mesh = Read(options);
  if (!mesh) return Fail(mesh.error());
  return Builder(options, std::move(*mesh)).Build(num_threads);
}

IoExpected<double> MeshFloorDepth(const MeshOptions& options) {
  const auto mesh = Read(options);
  if (!mesh) return Fail(mesh.error());
  double sum = 0.0;
  for (const Vec3& v : WorldVertices(*mesh, options.z_is_up)) sum += v.z();
  return sum / static_cast<double>(mesh->vertices.size());
}

}  // namespace rsfm::simulator

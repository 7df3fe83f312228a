#include "tools/simulator/ground_truth.h"

#include <bit>
#include <cstring>

#include "rsfm/io/atomic_output.h"

namespace rsfm::simulator {
namespace {

static_assert(std::endian::native == std::endian::little, "the files below are little-endian");

template <class T>
void Append(const T& value, std::string* bytes) {
  bytes->append(reinterpret_cast<const char*>(&value), sizeof value);
}

}  // namespace

IoStatus WriteMeshPly(const Scene& scene, const std::filesystem::path& path) {
  std::size_t num_vertices = 0;
  std::size_t num_triangles = 0;
  for (const TriangleMesh& mesh : scene.meshes()) {
    num_vertices += mesh.vertices.size();
    num_triangles += mesh.triangles.size();
  }
  auto file = AtomicFile::Create(path);
  if (!file) return Fail(file.error());
  std::string bytes = "ply\nformat binary_little_endian 1.0\ncomment world: local NED, metres\n";
  bytes += "element vertex " + std::to_string(num_vertices);
  bytes += "\nproperty float x\nproperty float y\nproperty float z\n";
  bytes += "element face " + std::to_string(num_triangles);
  bytes += "\nproperty list uchar int vertex_indices\nend_header\n";
  if (auto status = file->Write(bytes); !status) return status;
  const Vec3 offset = scene.WorldOffset();
  for (const TriangleMesh& mesh : scene.meshes()) {
    bytes.clear();
    for (const Vec3f& vertex : mesh.vertices) {
      const Vec3f in_world = (vertex.cast<double>() + offset).cast<float>();
      for (int i = 0; i < 3; ++i) Append(in_world[i], &bytes);
    }
    if (auto status = file->Write(bytes); !status) return status;
  }
  std::int32_t first = 0;
  for (const TriangleMesh& mesh : scene.meshes()) {
    bytes.clear();
    for (const auto& triangle : mesh.triangles) {
      Append(std::uint8_t{3}, &bytes);
      for (const std::uint32_t vertex : triangle) {
        Append(first + static_cast<std::int32_t>(vertex), &bytes);
      }
    }
    if (auto status = file->Write(bytes); !status) return status;
    first += static_cast<std::int32_t>(mesh.vertices.size());
  }
  return file->Commit();
}

IoStatus WritePfm(int width, int height, const std::vector<float>& values,
                  const std::filesystem::path& path) {
  std::string bytes = "Pf\n" + std::to_string(width) + " " + std::to_string(height) + "\n-1.0\n";
  const std::size_t row_bytes = sizeof(float) * static_cast<std::size_t>(width);
  for (int y = height - 1; y >= 0; --y) {
    bytes.append(reinterpret_cast<const char*>(&values[static_cast<std::size_t>(y) * width]),
                 row_bytes);
  }
  return WriteFileAtomically(path, bytes);
}

}  // namespace rsfm::simulator

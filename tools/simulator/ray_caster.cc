#include "tools/simulator/ray_caster.h"

#include <embree3/rtcore.h>

#include <cstring>
#include <limits>

namespace rsfm::simulator {
namespace {

constexpr std::size_t kPacket = 8;
constexpr float kInfinity = std::numeric_limits<float>::infinity();

class EmbreeCaster final : public RayCaster {
 public:
  EmbreeCaster(RTCDevice device, std::span<const TriangleMesh> meshes)
      : device_(device), scene_(rtcNewScene(device)) {
    rtcSetSceneFlags(scene_, RTC_SCENE_FLAG_ROBUST);  // no ray slips through an edge
    rtcSetSceneBuildQuality(scene_, RTC_BUILD_QUALITY_MEDIUM);
    for (std::size_t i = 0; i < meshes.size(); ++i) {
      if (meshes[i].triangles.empty()) continue;
      RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
      CopyBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, RTC_FORMAT_FLOAT3, meshes[i].vertices);
      CopyBuffer(geometry, RTC_BUFFER_TYPE_INDEX, RTC_FORMAT_UINT3, meshes[i].triangles);
      rtcCommitGeometry(geometry);
      rtcAttachGeometryByID(scene_, geometry, static_cast<unsigned>(i));
      rtcReleaseGeometry(geometry);
    }
    rtcCommitScene(scene_);
  }
  EmbreeCaster(const EmbreeCaster&) = delete;
  EmbreeCaster& operator=(const EmbreeCaster&) = delete;
  ~EmbreeCaster() override {
    rtcReleaseScene(scene_);
    rtcReleaseDevice(device_);
  }

  void Trace(const RaySoa& rays, std::span<RayHit> hits) const override {
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
    for (std::size_t first = 0; first < rays.size(); first += kPacket) {
      const std::size_t count = std::min(kPacket, rays.size() - first);
      alignas(32) RTCRayHit8 packet{};
      alignas(32) int valid[kPacket] = {};
      const auto fill = [&](const std::vector<float>& from, float* to) {
        std::memcpy(to, &from[first], count * sizeof(float));
      };
      fill(rays.ox, packet.ray.org_x);
      fill(rays.oy, packet.ray.org_y);
      fill(rays.oz, packet.ray.org_z);
      fill(rays.dx, packet.ray.dir_x);
      fill(rays.dy, packet.ray.dir_y);
      fill(rays.dz, packet.ray.dir_z);
      for (std::size_t i = 0; i < count; ++i) {
        const bool has_direction = packet.ray.dir_x[i] != 0.0f || packet.ray.dir_y[i] != 0.0f ||
                                   packet.ray.dir_z[i] != 0.0f;
        valid[i] = has_direction ? -1 : 0;
        packet.ray.tfar[i] = kInfinity;
        packet.ray.mask[i] = ~0u;
        packet.hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;
        packet.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
      }
      rtcIntersect8(valid, scene_, &context, &packet);
      for (std::size_t i = 0; i < count; ++i) {
        const bool is_hit = packet.hit.geomID[i] != RTC_INVALID_GEOMETRY_ID;
        hits[first + i] = {is_hit ? packet.ray.tfar[i] : -1.0f, packet.hit.geomID[i],
                           packet.hit.primID[i], packet.hit.u[i], packet.hit.v[i]};
      }
    }
  }

  std::optional<RayHit> Trace(const Vec3f& origin, const Vec3f& direction) const override {
    RaySoa rays;
    rays.Resize(1);
    rays.ox[0] = origin.x();
    rays.oy[0] = origin.y();
    rays.oz[0] = origin.z();
    rays.dx[0] = direction.x();
    rays.dy[0] = direction.y();
    rays.dz[0] = direction.z();
    RayHit hit;
    Trace(rays, {&hit, 1});
    if (hit.range_m < 0.0f) return std::nullopt;
    return hit;
  }

 private:
  template <class T>
  static void CopyBuffer(RTCGeometry geometry, RTCBufferType type, RTCFormat format,
                         const std::vector<T>& values) {
    static_assert(sizeof(T) == 12);
    void* target = rtcSetNewGeometryBuffer(geometry, type, 0, format, sizeof(T), values.size());
    std::memcpy(target, values.data(), values.size() * sizeof(T));
  }

  RTCDevice device_;
  RTCScene scene_;
};

}  // namespace

void RaySoa::Resize(std::size_t size) {
  for (std::vector<float>* values : {&ox, &oy, &oz, &dx, &dy, &dz}) values->resize(size);
}

std::unique_ptr<RayCaster> RayCaster::Create(std::span<const TriangleMesh> meshes) {
  RTCDevice device = rtcNewDevice("threads=1,set_affinity=0,max_isa=avx2");
  if (device == nullptr) return nullptr;
  return std::make_unique<EmbreeCaster>(device, meshes);
}

}  // namespace rsfm::simulator

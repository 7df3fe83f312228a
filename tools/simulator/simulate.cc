#include "tools/simulator/simulate.h"

#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <mutex>
#include <opencv2/core/mat.hpp>
#include <opencv2/imgcodecs.hpp>

#include "rsfm/io/atomic_output.h"
#include "rsfm/io/mission.h"
#include "rsfm/io/trajectory.h"
#include "tools/common/parallel.h"
#include "tools/simulator/ground_truth.h"
#include "tools/simulator/nav_log.h"

namespace rsfm::simulator {
namespace {

constexpr double kMaxAreaM2 = 20000.0;
constexpr double kMarginM = 0.6;
constexpr double kNavLeadS = 2.0;
constexpr double kMinClearanceM = 0.05;

struct Shot {
  std::string name;
  double time_s = 0.0;
  Utime utime = 0;
  Rigid3 world_from_camera;
};

class MissionBuilder {
 public:
  MissionBuilder(const Scenario& scenario, const SimulationHooks& hooks)
      : scenario_(scenario), hooks_(hooks) {}

  IoExpected<SimulationReport> Run(const std::filesystem::path& out) {
    const auto camera = AnyCamera::Create(scenario_.rig.camera);
    if (!camera) return Refuse("rig.camera", camera.error().where, "correct the rig");
    if (auto status = PlanFloor(); !status) return Fail(status.error());
    if (auto status = PlanShots(); !status) return Fail(status.error());
    if (scenario_.scene == SceneKind::kSeafloor) {
      if (auto status = PlanArea(*camera); !status) return Fail(status.error());
    }
    auto folder = AtomicFolder::Create(out, Existing::kReplace);
    if (!folder) return Fail(folder.error());
    const auto made = MakeScene();
    if (!made) return Fail(made.error());
    const auto& scene = *made;
    const auto caster = RayCaster::Create(scene->meshes());
    if (caster == nullptr) {
      return Fail({Errc::kUnsupported, "", "Embree", "cannot be started on this machine", ""});
    }
    if (auto status = CheckClearance(*scene, *caster); !status) return Fail(status.error());
    const Water water(scenario_.water, ExposedRange(*scene, *caster), scenario_.sensor.grey);
    const Renderer renderer(*camera, *scene, *caster, water, scenario_.sensor, hooks_.num_threads);
    if (renderer.CoveredFraction() < 0.01) {
      return Refuse("rig", "hardly any pixel has a ray through the port into the water",
                    "check the lens parameters and the port");
    }
    if (auto status = WriteNavigation(folder->aside(), *scene, *caster); !status) {
      return Fail(status.error());
    }
    if (scenario_.images.render) {
      if (auto status = WriteImages(folder->aside(), renderer); !status)
        return Fail(status.error());
    }
    if (report_.interrupted) return report_;
    if (auto status = WriteTruth(folder->aside(), *scene); !status) return Fail(status.error());
    if (auto status = folder->Commit(); !status) return Fail(status.error());
    return report_;
  }

 private:
  static tl::unexpected<Diagnostic> Refuse(std::string field, std::string problem,
                                           std::string fix) {
    return Fail({Errc::kInvalidArgument, "", std::move(field), std::move(problem), std::move(fix)});
  }

  // What altitudes and heights refer to.
  IoStatus PlanFloor() {
    floor_depth_m_ = scenario_.seafloor.depth_m;
    if (scenario_.scene == SceneKind::kTank) floor_depth_m_ = scenario_.tank.depth_m;
    if (scenario_.scene == SceneKind::kMesh) {
      const auto depth = MeshFloorDepth(scenario_.mesh);
      if (!depth) return Fail(depth.error());
      floor_depth_m_ = *depth;
    }
    if (scenario_.scene != SceneKind::kSeafloor || scenario_.dem.empty()) return {};
    auto grid = HeightGrid::Read(scenario_.dem);
    if (!grid) return Fail(grid.error());
    scenario_.seafloor.grid = std::make_shared<HeightGrid>(std::move(*grid));
    return {};
  }

  IoStatus MakeTrajectory() {
    const double rate_hz = scenario_.images.rate_hz;
    const Rigid3& body_from_camera = scenario_.rig.body_from_camera;
    altitude_m_ = scenario_.trajectory.altitude_m;
    if (scenario_.path == PathKind::kOrbit) {
      trajectory_ = MakeOrbit(scenario_.orbit, body_from_camera, floor_depth_m_, rate_hz);
    } else if (scenario_.path == PathKind::kRecorded) {
      auto recorded =
          LoadRecorded(scenario_.recorded, body_from_camera, floor_depth_m_, &altitude_m_);
      if (!recorded) return Fail(recorded.error());
      trajectory_ = std::move(*recorded);
    } else {
      const int images = scenario_.images.survey_images;
      trajectory_ = MakeLawnmower(
          images > 0 ? FitToImages(scenario_.trajectory, images, rate_hz) : scenario_.trajectory,
          floor_depth_m_);
    }
    return {};
  }

  IoExpected<std::unique_ptr<Scene>> MakeScene() const {
    if (scenario_.scene == SceneKind::kTank) return MakeTank(scenario_.tank, hooks_.num_threads);
    if (scenario_.scene == SceneKind::kMesh) {
      return LoadMeshScene(scenario_.mesh, hooks_.num_threads);
    }
    return MakeSeafloor(scenario_.seafloor, hooks_.num_threads);
  }

  IoStatus PlanShots() {
    if (auto status = MakeTrajectory(); !status) return status;
    int limit = scenario_.images.max_images;
    if (scenario_.path == PathKind::kLawnmower && scenario_.images.survey_images > 0) {
      limit = limit > 0 ? std::min(limit, scenario_.images.survey_images)
                        : scenario_.images.survey_images;
    }
    const char* extension = scenario_.images.format == ImageOptions::Format::kPng ? "png" : "jpg";
    const double period = 1.0 / scenario_.images.rate_hz;
    for (int i = 0; i * period <= trajectory_->duration_s() + 1e-6; ++i) {
      if (limit > 0 && i >= limit) break;
      Shot shot;
      char name[32];
      std::snprintf(name, sizeof name, "%06d.%s", i, extension);
      shot.name = name;
      shot.time_s = i * period;
      shot.utime = scenario_.images.start_utime + UsFromSeconds(shot.time_s);
      shot.world_from_camera =
          trajectory_->WorldFromBody(shot.time_s) * scenario_.rig.body_from_camera;
      if (!shots_.empty()) {
        report_.path_length_m +=
            (shot.world_from_camera.translation - shots_.back().world_from_camera.translation)
                .norm();
      }
      shots_.push_back(shot);
    }
    report_.num_images = static_cast<int>(shots_.size());
    return {};
  }

  // The seafloor under all that any image can see, from the rays of the image's border.
  IoStatus PlanArea(const AnyCamera& camera) {
    constexpr int kSteps = 8;
    std::vector<Ray3> border;
    for (int i = 0; i <= kSteps; ++i) {
      for (int j = 0; j <= kSteps; ++j) {
        if (i % kSteps != 0 && j % kSteps != 0) continue;
        Ray3 ray;
        const Vec2 pixel(camera.width() * i / double{kSteps}, camera.height() * j / double{kSteps});
        if (camera.Backproject(pixel, &ray) == Projection::kOk) border.push_back(ray);
      }
    }
    border.emplace_back();  // the camera itself
    SeafloorOptions& floor = scenario_.seafloor;
    const double hollow = floor.grid ? -floor.grid->Lowest() : 1.5 * floor.relief_m;
    const double lowest = floor.depth_m + hollow + floor.ripple_height_m;
    floor.min_ne_m = Vec2::Constant(1e9);
    floor.max_ne_m = Vec2::Constant(-1e9);
    for (const Shot& shot : shots_) {
      for (const Ray3& ray : border) {
        const Vec3 origin = shot.world_from_camera * ray.origin;
        const Vec3 direction = shot.world_from_camera.rotation * ray.direction;
        // What looks along the floor or up sees no farther than ten altitudes.
        const double reach = 10.0 * std::max(0.1, floor.depth_m - origin.z());
        const double down = (lowest - origin.z()) / std::max(direction.z(), 1e-3);
        const Vec2 place = (origin + std::min(std::abs(down), reach) * direction).head<2>();
        floor.min_ne_m = floor.min_ne_m.cwiseMin(place);
        floor.max_ne_m = floor.max_ne_m.cwiseMax(place);
      }
    }
    floor.min_ne_m.array() -= kMarginM;
    floor.max_ne_m.array() += kMarginM;
    if (floor.grid) {
      const Vec2 half = floor.grid->HalfSize();
      for (const Shot& shot : shots_) {
        const Vec2 place = shot.world_from_camera.translation.head<2>();
        if ((place.cwiseAbs().array() <= half.array()).all()) continue;
        char problem[160];
        std::snprintf(problem, sizeof problem,
                      "image %s is taken beyond the grid, which reaches %.1f m north and %.1f m "
                      "east of its middle",
                      shot.name.c_str(), half.x(), half.y());
        return Refuse("trajectory", problem, "keep the path over the grid");
      }
      floor.min_ne_m = floor.min_ne_m.cwiseMax(-half);
      floor.max_ne_m = floor.max_ne_m.cwiseMin(half);
    }
    const Vec2 size = floor.max_ne_m - floor.min_ne_m;
    if (size.x() * size.y() <= kMaxAreaM2) return {};
    char problem[128];
    std::snprintf(problem, sizeof problem, "the images would cover %.0f m x %.0f m of seafloor",
                  size.x(), size.y());
    return Refuse("trajectory", problem, "shorten the legs, or set images.max_images");
  }

  // Of the camera over a shot's exposure; one without motion blur.
  std::vector<Rigid3> PosesOver(const Shot& shot) const {
    if (!scenario_.sensor.motion_blur) return {shot.world_from_camera};
    std::vector<Rigid3> poses;
    const int count = scenario_.sensor.samples_per_pixel;
    for (int i = 0; i < count; ++i) {
      const double offset = scenario_.sensor.exposure_s * ((i + 0.5) / count - 0.5);
      poses.push_back(trajectory_->WorldFromBody(shot.time_s + offset) *
                      scenario_.rig.body_from_camera);
    }
    return poses;
  }

  static double AltitudeAt(const Scene& scene, const RayCaster& caster, const Vec3& in_world) {
    const Vec3 in_scene = in_world - scene.WorldOffset();
    const auto hit = caster.Trace(in_scene.cast<float>(), Vec3f::UnitZ());
    return hit ? static_cast<double>(hit->range_m) : -1.0;
  }

  // Distance in water along the optical axis that the exposure is set for.
  double ExposedRange(const Scene& scene, const RayCaster& caster) const {
    if (scenario_.path == PathKind::kLawnmower) return altitude_m_;
    std::vector<double> ranges_m;
    for (const Shot& shot : shots_) {
      const Vec3 in_scene = shot.world_from_camera.translation - scene.WorldOffset();
      const Vec3 axis = shot.world_from_camera.rotation * Vec3::UnitZ();
      const auto hit = caster.Trace(in_scene.cast<float>(), axis.cast<float>());
      if (hit) ranges_m.push_back(hit->range_m);
    }
    if (ranges_m.empty()) return 1.0;
    const auto middle = ranges_m.begin() + static_cast<std::ptrdiff_t>(ranges_m.size() / 2);
    std::nth_element(ranges_m.begin(), middle, ranges_m.end());
    return *middle;
  }

  IoStatus CheckClearance(const Scene& scene, const RayCaster& caster) const {
    for (const Shot& shot : shots_) {
      const Vec3& place = shot.world_from_camera.translation;
      if (scenario_.scene == SceneKind::kSeafloor) {
        if (AltitudeAt(scene, caster, place) >= kMinClearanceM) continue;
        return Refuse("trajectory.altitude_m",
                      "the camera would touch the seafloor in image " + shot.name,
                      "fly higher, or lower the relief and stone_max_radius_m");
      }
      if (IsClear(scene, caster, place)) continue;
      return Refuse("trajectory",
                    "the camera would touch or be behind a surface in image " + shot.name,
                    "move the path away from walls and objects");
    }
    return {};
  }

  // No surface nearer than the clearance in 26 directions, nor one seen from behind.
  static bool IsClear(const Scene& scene, const RayCaster& caster, const Vec3& in_world) {
    const Vec3f origin = (in_world - scene.WorldOffset()).cast<float>();
    for (int i = 0; i < 27; ++i) {
      const Vec3f direction(static_cast<float>(i % 3 - 1), static_cast<float>(i / 3 % 3 - 1),
                            static_cast<float>(i / 9 - 1));
      if (direction.isZero()) continue;
      const auto hit = caster.Trace(origin, direction.normalized());
      if (!hit) continue;
      const TriangleMesh& mesh = scene.meshes()[hit->mesh];
      const auto& [a, b, c] = mesh.triangles[hit->triangle];
      const Vec3f normal =
          (mesh.vertices[b] - mesh.vertices[a]).cross(mesh.vertices[c] - mesh.vertices[a]);
      if (hit->range_m < kMinClearanceM || normal.dot(direction) > 0.0f) return false;
    }
    return true;
  }

  IoStatus WriteNavigation(const std::filesystem::path& folder, const Scene& scene,
                           const RayCaster& caster);
  IoStatus WriteImages(const std::filesystem::path& folder, const Renderer& renderer);
  IoStatus WriteImage(const std::filesystem::path& folder, const Renderer& renderer, int index);
  IoStatus WriteTruth(const std::filesystem::path& folder, const Scene& scene);

  Scenario scenario_;
  const SimulationHooks& hooks_;
  double floor_depth_m_ = 0.0;
  double altitude_m_ = 0.0;
  std::unique_ptr<Trajectory> trajectory_;
  std::vector<Shot> shots_;
  SimulationReport report_;
};

IoStatus MissionBuilder::WriteNavigation(const std::filesystem::path& folder, const Scene& scene,
                                         const RayCaster& caster) {
  const auto altitude_at = [&](const Vec3& place) { return AltitudeAt(scene, caster, place); };
  const std::vector<NavMeasurement> measurements = SimulateNavigation(
      *trajectory_, scenario_.images.start_utime, kNavLeadS, altitude_at, scenario_.navigation);
  EventLogWriterOptions options;
  options.sync_to_disk = false;  // the folder is forced to the disk as a whole
  auto writer = MissionWriter::Create(folder, scenario_.rig, options);
  if (!writer) return Fail(writer.error());
  std::optional<LocalFrame> frame;
  if (scenario_.rig.world.origin) {
    const auto made = LocalFrame::Create(*scenario_.rig.world.origin);
    if (!made) return Refuse("rig.world.origin", made.error().where, "correct the rig");
    frame = *made;
  }
  for (const NavMeasurement& measurement : measurements) {
    const LocalFrame* at = frame ? &*frame : nullptr;
    if (auto status = LogMeasurement(measurement, scenario_.rig, at, &*writer); !status) {
      return status;
    }
  }
  std::vector<ImageTime> times;
  for (const Shot& shot : shots_) times.push_back({shot.name, shot.utime});
  if (auto status = writer->WriteImageTimes(times); !status) return status;
  if (auto status = writer->Close(); !status) return status;
  const std::vector<NavSample> samples = MergeSamples(measurements);
  report_.num_nav_samples = static_cast<int>(samples.size());
  if (samples.empty()) return {};  // all sensors are off: a mission without navigation
  return WriteNavTable(samples, folder / "nav.csv");
}

IoStatus MissionBuilder::WriteImage(const std::filesystem::path& folder, const Renderer& renderer,
                                    int index) {
  const Shot& shot = shots_[index];
  RenderedImage image;
  renderer.Render(PosesOver(shot), static_cast<std::uint32_t>(index), &image);
  const cv::Mat pixels(image.height, image.width, CV_8UC3, image.bgr.data());
  std::vector<int> parameters = {cv::IMWRITE_JPEG_QUALITY, scenario_.images.jpeg_quality};
  std::string extension = ".jpg";
  if (scenario_.images.format == ImageOptions::Format::kPng) {
    parameters = {cv::IMWRITE_PNG_COMPRESSION, 1};
    extension = ".png";
  }
  std::vector<unsigned char> bytes;
  const std::filesystem::path path = folder / kImagesFolder / shot.name;
  if (!cv::imencode(extension, pixels, bytes, parameters)) {
    return Fail({Errc::kIo, path.string(), "", "cannot be encoded", ""});
  }
  const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  if (auto status = WriteFileAtomically(path, text); !status) return status;
  if (!scenario_.ground_truth.range) return {};
  std::vector<float> range_m;
  renderer.RenderRange(shot.world_from_camera, &range_m);
  const auto name = std::filesystem::path(shot.name).replace_extension(".pfm");
  return WritePfm(image.width, image.height, range_m, folder / kGroundTruthFolder / "range" / name);
}

IoStatus MissionBuilder::WriteImages(const std::filesystem::path& folder,
                                     const Renderer& renderer) {
  const auto start = std::chrono::steady_clock::now();
  std::mutex mutex;
  IoStatus result;
  int done = 0;
  std::atomic<bool> stop = false;
  const int total = static_cast<int>(shots_.size());
  ParallelFor(total, hooks_.num_threads, [&](int i) {
    if (stop) return;
    if (hooks_.is_interrupted && hooks_.is_interrupted()) {
      stop = true;
      const std::scoped_lock lock(mutex);
      report_.interrupted = true;
      return;
    }
    const IoStatus status = WriteImage(folder, renderer, i);
    const std::scoped_lock lock(mutex);
    if (!status) {
      stop = true;
      if (result) result = status;
      return;
    }
    ++done;
    if (hooks_.progress) hooks_.progress(done, total);
  });
  report_.rendering_s =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return result;
}

IoStatus MissionBuilder::WriteTruth(const std::filesystem::path& folder, const Scene& scene) {
  const std::filesystem::path truth = folder / kGroundTruthFolder;
  Model model;
  model.rig = scenario_.rig;
  model.cameras.push_back({1, scenario_.rig.camera});
  for (const Shot& shot : shots_) {
    ModelImage& image = model.images.emplace_back();
    image.name = shot.name;
    image.utime = shot.utime;
    image.camera_from_world = shot.world_from_camera.Inverse();
  }
  std::error_code error;
  std::filesystem::create_directories(truth, error);
  const std::string tum = FormatTum(TrajectoryOf(model));
  if (auto status = WriteFileAtomically(truth / "trajectory.tum", tum); !status) return status;
  if (auto status = WriteModelFiles(model, truth); !status) return status;
  if (!scenario_.ground_truth.mesh) return {};
  return WriteMeshPly(scene, truth / "mesh.ply");
}

}  // namespace

IoExpected<SimulationReport> Simulate(const Scenario& scenario, const std::filesystem::path& out,
                                      const SimulationHooks& hooks) {
  return MissionBuilder(scenario, hooks).Run(out);
}

}  // namespace rsfm::simulator

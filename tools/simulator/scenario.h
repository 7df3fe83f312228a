// A scenario: all that a simulated mission is made from, in one YAML file.
#pragma once

#include <filesystem>

#include "rsfm/io/rig.h"
#include "tools/simulator/mesh_scene.h"
#include "tools/simulator/nav_sensors.h"
#include "tools/simulator/recorded.h"
#include "tools/simulator/renderer.h"
#include "tools/simulator/seafloor.h"
#include "tools/simulator/tank.h"
#include "tools/simulator/trajectory.h"
#include "tools/simulator/water.h"

namespace rsfm::simulator {

struct ImageOptions {
  enum class Format { kPng, kJpeg };

  double rate_hz = 1.0;
  Format format = Format::kJpeg;
  int jpeg_quality = 92;
  int max_images = 0;  // 0: to the end of the trajectory
  int survey_images =
      0;  // a lawn-mower survey is made smaller until that many cover it; 0: as it is
  Utime start_utime = 1'767'225'600'000'000;  // of the first image: 2026-01-01 00:00 UTC
  bool render = true;  // false: navigation and truth alone, of a mission that has its images
};

struct GroundTruthOptions {
  bool mesh = true;    // the scene as mesh.ply
  bool range = false;  // a range image per image, 32-bit float, metres along the ray in water
};

// kSeafloor: generated, or over a height grid.
enum class SceneKind : std::uint8_t { kSeafloor, kTank, kMesh };
enum class PathKind : std::uint8_t { kLawnmower, kOrbit, kRecorded };

struct Scenario {
  std::uint64_t seed = 1;  // of everything; the parts derive theirs from it
  Rig rig;
  ImageOptions images;
  PathKind path = PathKind::kLawnmower;
  LawnmowerOptions trajectory;
  OrbitOptions orbit;
  RecordedOptions recorded;
  SceneKind scene = SceneKind::kSeafloor;
  SeafloorOptions seafloor;  // its area is that of the trajectory's footprints
  TankOptions tank;
  MeshOptions mesh;
  std::filesystem::path dem;  // of the seafloor; empty: none
  WaterOptions water;
  SensorOptions sensor;
  NavSensorOptions navigation;
  GroundTruthOptions ground_truth;
};

// Reads a scenario file. `rig` is required: a mapping with rig.yaml's sections, or the path of a
// rig file, relative to the scenario's. All else has its default. Unknown, mistyped and
// out-of-range fields are errors that name file, line, field and fix; `problems`, where given, gets
// all of them.
IoExpected<Scenario> ReadScenario(const std::filesystem::path& path,
                                  std::vector<Diagnostic>* problems = nullptr);
// The same from text; `path` stands for the file in messages and for relative paths.
IoExpected<Scenario> ParseScenario(const std::string& text, const std::filesystem::path& path,
                                   std::vector<Diagnostic>* problems = nullptr);

}  // namespace rsfm::simulator

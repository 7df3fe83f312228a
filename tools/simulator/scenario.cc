#include "tools/simulator/scenario.h"

#include <yaml-cpp/yaml.h>

#include <cmath>

#include "rsfm/io/atomic_output.h"
#include "rsfm/io/text.h"
#include "rsfm/io/yaml_map.h"
#include "tools/simulator/scenario_section.h"

namespace rsfm::simulator {
namespace {

constexpr std::size_t kMaxScenarioBytes = std::size_t{1} << 20;

void ReadImages(YamlMap* root, ImageOptions* images) {
  Section s(root, "images");
  s.Get("rate_hz", kRate, &images->rate_hz);
  bool is_jpeg = images->format == ImageOptions::Format::kJpeg;
  s.GetWord("format", "png", "jpg", &is_jpeg);
  images->format = is_jpeg ? ImageOptions::Format::kJpeg : ImageOptions::Format::kPng;
  s.Get("jpeg_quality", 1, 100, &images->jpeg_quality);
  s.Get("max_images", 0, 1'000'000, &images->max_images);
  s.Get("survey_images", 0, 1'000'000, &images->survey_images);
  s.Get("start_utime", &images->start_utime);
}

void ReadStrobes(Section* water, std::vector<Strobe>* strobes) {
  const YAML::Node list = water->map().GetList("strobes", Need::kOptional);
  if (!list) return;
  strobes->clear();
  for (std::size_t i = 0; i < list.size(); ++i) {
    YamlMap entry(list[i], water->map().PathOf("strobes") + "[" + std::to_string(i) + "]",
                  water->map().file(), water->map().problems());
    Strobe strobe;
    entry.GetVec3("position_m", Need::kRequired, &strobe.position_in_camera);
    entry.GetNumber("beam_angle_deg", Need::kOptional, {1.0, 90.0, "give degrees from 1 to 90"},
                    &strobe.beam_angle_deg);
    entry.Finish();
    strobes->push_back(strobe);
  }
}

void ReadWater(YamlMap* root, WaterOptions* w) {
  Section s(root, "water");
  constexpr const char* kPerMetre = "give three values per metre, from 0 to 100: red, green, blue";
  constexpr const char* kLevels = "give three levels from 0 to 1: red, green, blue";
  s.Get("attenuation", &w->attenuation);
  s.GetVec3("attenuation_per_m", 0.0, 100.0, kPerMetre, &w->attenuation_per_m);
  s.Get("backscatter", &w->backscatter);
  s.GetVec3("backscatter_level", 0.0, 1.0, kLevels, &w->backscatter_level);
  s.GetVec3("backscatter_per_m", 0.0, 100.0, kPerMetre, &w->backscatter_per_m);
  s.Get("strobe", &w->strobe);
  if (s.is_there()) ReadStrobes(&s, &w->strobes);
  s.Get("ambient", {0.0, 10.0, "give a level from 0 to 10, 1 being the strobes'"}, &w->ambient);
  s.Get("white_balance", kShare, &w->white_balance);
}

void ReadSensor(YamlMap* root, SensorOptions* o) {
  Section s(root, "sensor");
  s.Get("samples_per_pixel", 1, 64, &o->samples_per_pixel);
  const int side = static_cast<int>(std::lround(std::sqrt(o->samples_per_pixel)));
  if (side * side != o->samples_per_pixel) {
    s.map().AddProblem("samples_per_pixel",
                       "is not a square number: " + std::to_string(o->samples_per_pixel),
                       "give 1, 4, 9, 16, 25, 36, 49 or 64");
  }
  s.Get("motion_blur", &o->motion_blur);
  s.Get("exposure_s", {1e-6, 1.0, "give seconds, from 0.000001 to 1"}, &o->exposure_s);
  if (o->motion_blur && o->samples_per_pixel < 4) {
    s.map().AddProblem("samples_per_pixel", "is too little for motion_blur", "give 4 or more");
  }
  s.Get("noise", &o->noise);
  s.Get("full_well_electrons", {10.0, 1e7, "give electrons, from 10 to 10000000"},
        &o->full_well_electrons);
  s.Get("read_noise_electrons", kElectrons, &o->read_noise_electrons);
  s.Get("vignetting", &o->vignetting);
  s.Get("vignetting_at_corner", kShare, &o->vignetting_at_corner);
  s.Get("gamma", &o->gamma);
  s.Get("grey", {0.001, 1.0, "give a level from 0.001 to 1"}, &o->grey);
}

void ReadTiming(Section* s, SensorTiming* timing) {
  s->Get("enabled", &timing->enabled);
  s->Get("rate_hz", kRate, &timing->rate_hz);
  s->Get("dropout", kShare, &timing->dropout);
  s->Get("delay_s", kDelay, &timing->delay_s);
}

void ReadNavigation(YamlMap* root, NavSensorOptions* n) {
  Section s(root, "navigation");
  if (!s.is_there()) return;
  {
    Section a(&s.map(), "attitude");
    ReadTiming(&a, &n->attitude.timing);
    a.Get("roll_pitch_sigma_deg", kSigma, &n->attitude.roll_pitch_sigma_deg);
    a.Get("heading_sigma_deg", kSigma, &n->attitude.heading_sigma_deg);
    a.Get("heading_bias_sigma_deg", kSigma, &n->attitude.heading_bias_sigma_deg);
    a.Get("heading_bias_time_s", kSeconds, &n->attitude.heading_bias_time_s);
    a.Get("roll_bias_deg", kSmallAngle, &n->attitude.roll_bias_deg);
    a.Get("pitch_bias_deg", kSmallAngle, &n->attitude.pitch_bias_deg);
    a.Get("heading_offset_deg", kDegrees, &n->attitude.heading_offset_deg);
  }
  {
    Section d(&s.map(), "dvl");
    ReadTiming(&d, &n->dvl.timing);
    d.Get("sigma_mps", kSigma, &n->dvl.sigma_mps);
    d.Get("scale_error", {-0.5, 0.5, "give a share from -0.5 to 0.5"}, &n->dvl.scale_error);
    d.Get("heading_misalignment_deg", kSmallAngle, &n->dvl.heading_misalignment_deg);
    d.GetVec3("bias_mps", -10.0, 10.0, "give metres per second, forward, right and down",
              &n->dvl.bias_mps);
    d.Get("altitude_sigma_m", kSigma, &n->dvl.altitude_sigma_m);
  }
  {
    Section d(&s.map(), "depth");
    ReadTiming(&d, &n->depth.timing);
    d.Get("sigma_m", kSigma, &n->depth.sigma_m);
    d.Get("bias_m", {-1e3, 1e3, "give metres"}, &n->depth.bias_m);
  }
  {
    Section a(&s.map(), "altimeter");
    ReadTiming(&a, &n->altimeter.timing);
    a.Get("sigma_m", kSigma, &n->altimeter.sigma_m);
    a.Get("bias_m", {-1e3, 1e3, "give metres"}, &n->altimeter.bias_m);
  }
  Section p(&s.map(), "position");
  ReadTiming(&p, &n->position.timing);
  p.Get("horizontal_sigma_m", kSigma, &n->position.horizontal_sigma_m);
  p.Get("vertical_sigma_m", kSigma, &n->position.vertical_sigma_m);
  p.Get("drift_sigma_m", kSigma, &n->position.drift_sigma_m);
  p.Get("drift_time_s", kSeconds, &n->position.drift_time_s);
}

void ReadRigOf(YamlMap* root, const YAML::Node& document, const std::filesystem::path& path,
               Rig* rig) {
  const YAML::Node node = document["rig"];
  std::vector<Diagnostic> problems;
  if (node && node.IsScalar()) {
    std::string file;
    if (!root->GetText("rig", Need::kRequired, &file)) return;
    if (auto read = ReadRig(path.parent_path() / file, &problems)) *rig = *read;
  } else {
    if (!root->GetMap("rig", Need::kRequired)) return;
    YAML::Emitter text;
    text << node;
    if (auto read = ParseRig(text.c_str(), root->file(), &problems)) *rig = *read;
    for (Diagnostic& problem : problems) {
      problem.field = problem.field.empty() ? "rig" : "rig." + problem.field;
      problem.line = 0;  // of the section alone, not of the file
    }
  }
  root->problems()->insert(root->problems()->end(), problems.begin(), problems.end());
}

void ReadAll(const YAML::Node& document, const std::filesystem::path& path,
             std::vector<Diagnostic>* problems, Scenario* scenario) {
  YamlMap root(document, "", path.string(), problems);
  std::int64_t seed = 1;
  if (root.GetInteger("seed", Need::kOptional, 0, INT64_MAX, &seed)) {
    scenario->seed = static_cast<std::uint64_t>(seed);
  }
  if (document.IsMap()) ReadRigOf(&root, document, path, &scenario->rig);
  ReadImages(&root, &scenario->images);
  ReadScene(&root, path.parent_path(), scenario);
  ReadTrajectory(&root, path.parent_path(), scenario);
  ReadWater(&root, &scenario->water);
  ReadSensor(&root, &scenario->sensor);
  ReadNavigation(&root, &scenario->navigation);
  {
    Section s(&root, "ground_truth");
    s.Get("mesh", &scenario->ground_truth.mesh);
    s.Get("range", &scenario->ground_truth.range);
  }
  root.Finish();
}

}  // namespace

IoExpected<Scenario> ParseScenario(const std::string& text, const std::filesystem::path& path,
                                   std::vector<Diagnostic>* problems) {
  std::vector<Diagnostic> found;
  Scenario scenario;
  if (const auto document = ParseYaml(text, path.string()); !document) {
    found.push_back(document.error());
  } else {
    try {
      ReadAll(*document, path, &found, &scenario);
    } catch (const YAML::Exception& error) {
      found.push_back({Errc::kCorrupt, path.string(), "", "cannot be read: " + error.msg,
                       "repair the line", error.mark.line + 1});
    }
  }
  if (problems != nullptr) *problems = found;
  if (!found.empty()) return Fail(found.front());
  scenario.trajectory.seed = scenario.seed;
  scenario.seafloor.seed = scenario.seed;
  scenario.tank.seed = scenario.seed;
  scenario.mesh.seed = scenario.seed;
  scenario.sensor.seed = scenario.seed;
  scenario.navigation.seed = scenario.seed;
  scenario.navigation.dvl.dvl_in_body_m = scenario.rig.sensors.dvl_in_body_m;
  scenario.navigation.depth.depth_in_body_m = scenario.rig.sensors.depth_in_body_m;
  scenario.navigation.position.position_in_body_m = scenario.rig.sensors.position_in_body_m;
  scenario.rig.world.frame = WorldFrame::kNed;
  return scenario;
}

IoExpected<Scenario> ReadScenario(const std::filesystem::path& path,
                                  std::vector<Diagnostic>* problems) {
  const auto text = ReadWholeFile(path, kMaxScenarioBytes);
  if (!text) return Fail(text.error());
  return ParseScenario(*text, path, problems);
}

}  // namespace rsfm::simulator

#include "rsfm/io/camera_yaml.h"

#include <cmath>

#include "rsfm/io/text.h"
#include "rsfm/refraction/sea_water.h"

namespace rsfm {
namespace {

constexpr std::int64_t kMaxImageSide = 1 << 16;
constexpr double kMaxIndex = 4.0;
constexpr double kUnitTolerance = 1e-6;

constexpr Bounds kIndexBounds{1.0, kMaxIndex, "give an index of refraction from 1 to 4"};
constexpr Bounds kThicknessBounds{0.0, 1.0, "give metres from 0 to 1"};
constexpr Bounds kDistanceBounds{0.0, 10.0, "give metres from 0 to 10"};
constexpr Bounds kRadiusBounds{1e-6, 10.0, "give the inner radius in metres, over 0, up to 10"};
constexpr Bounds kWavelengthBounds{400.0, 700.0, "give nanometres from 400 to 700"};

// `water: {temperature_c, salinity_psu, depth_m}` in place of index_water, at the port's
// wavelength_nm unless it has its own. The index of sea water is relative to air, as the other two
// are where index_air is 1.
void ReadWater(YamlMap* port, double index_air, double wavelength_nm, double* index_water) {
  const YAML::Node node = port->GetMap("water", Need::kRequired);
  port->Ignore("index_water");
  if (port->Has("index_water")) {
    port->AddProblem("index_water", "is given beside water", "keep one of them");
  }
  if (!node) return;
  YamlMap map(node, port->PathOf("water"), port->file(), port->problems());
  constexpr Bounds kTemperature{0.0, 30.0, "give degrees Celsius from 0 to 30"};
  constexpr Bounds kSalinity{0.0, 43.0, "give practical salinity units from 0 to 43"};
  constexpr Bounds kDepth{0.0, 10700.0, "give metres below the surface from 0 to 10700"};
  WaterConditions water;
  water.wavelength_nm = wavelength_nm;
  bool is_good =
      map.GetNumber("temperature_c", Need::kRequired, kTemperature, &water.temperature_c);
  is_good &= map.GetNumber("salinity_psu", Need::kRequired, kSalinity, &water.salinity_psu);
  is_good &= map.GetNumber("depth_m", Need::kRequired, kDepth, &water.depth_m);
  map.GetNumber("wavelength_nm", Need::kOptional, kWavelengthBounds, &water.wavelength_nm);
  map.Finish();
  if (!is_good) return;
  const auto index = SeaWaterIndex(water);
  if (!index) {
    map.AddProblem(index.error().where, "is out of range", "see rsfm/refraction/sea_water.h");
    return;
  }
  *index_water = index_air * *index;
}

// The index of what light goes through: a number, or `glass: BK7` in its place, relative to air, as
// water.
void ReadGlass(YamlMap* port, const std::string& index_key, double index_air, double wavelength_nm,
               double* index_glass) {
  if (!port->Has("glass")) {
    port->GetNumber(index_key, Need::kRequired, kIndexBounds, index_glass);
    return;
  }
  std::string name;
  port->Ignore(index_key);
  if (port->Has(index_key)) {
    port->AddProblem(index_key, "is given beside glass", "keep one of them");
  }
  if (!port->GetText("glass", Need::kRequired, &name)) return;
  const auto glass = GlassFromName(name);
  if (!glass) {
    port->AddProblem(
        "glass", Quoted(name) + " is not a glass that is known here",
        "give BK7, fused_silica, sapphire or acrylic, or " + index_key + " as a number");
    return;
  }
  const auto index = GlassIndex(*glass, wavelength_nm);
  if (index) *index_glass = index_air * *index;  // the wavelength has been checked
}

// `layers: [{thickness_m, index or glass}, ...]` of a flat port, from the inside out, in place of
// thickness_m and the index of a single one.
void ReadLayers(YamlMap* port, double wavelength_nm, PortConfig* result) {
  for (const char* key : {"thickness_m", "index_glass", "glass"}) {
    port->Ignore(key);
    if (port->Has(key)) port->AddProblem(key, "is given beside layers", "move it into a layer");
  }
  const YAML::Node list = port->GetList("layers", Need::kRequired);
  if (!list) return;
  if (list.size() < 1 || list.size() > static_cast<std::size_t>(kMaxPortLayers)) {
    port->AddProblem("layers", "has " + std::to_string(list.size()) + " elements",
                     "give one to " + std::to_string(kMaxPortLayers) +
                         " of {thickness_m, index}, from the inside out");
    return;
  }
  for (std::size_t i = 0; i < list.size(); ++i) {
    YamlMap map(list[i], port->PathOf("layers[" + std::to_string(i) + "]"), port->file(),
                port->problems());
    PortLayer layer;
    map.GetNumber("thickness_m", Need::kRequired, kThicknessBounds, &layer.thickness_m);
    ReadGlass(&map, "index", result->index_air, wavelength_nm, &layer.index);
    map.Finish();
    if (i == 0) {
      result->thickness_m = layer.thickness_m;
      result->index_glass = layer.index;
    } else {
      result->outer_layers.TryPushBack(layer);
    }
  }
}

}  // namespace

std::string LensModelNames() {
  std::string text;
  for (const LensModel model : AllLensModels()) {
    text += (text.empty() ? "" : ", ") + std::string(ToString(model));
  }
  return text;
}

bool SetLens(const std::string& model, const std::vector<double>& params, CameraConfig* camera,
             std::string* field, std::string* problem, std::string* fix) {
  const auto lens = LensModelFromName(model);
  if (!lens) {
    *field = "model";
    *problem = Quoted(model) + " is not a lens model here";
    *fix = "give one of " + LensModelNames();
    return false;
  }
  *field = "params";
  const auto needed = static_cast<std::size_t>(NumLensParams(*lens));
  if (params.size() != needed) {
    *problem = "has " + std::to_string(params.size()) + " elements, " + model + " has " +
               std::to_string(needed);
    *fix = "give [" + std::string(LensParamNames(*lens)) + "]";
    return false;
  }
  for (int i = 0; i < NumFocalLengths(*lens); ++i) {
    if (params[i] > 0.0) continue;
    *problem = "focal length " + FormatNumber(params[i]) + " is not positive";
    *fix = "give it in pixels";
    return false;
  }
  camera->lens = *lens;
  camera->lens_params.clear();
  for (const double value : params) {
    if (!camera->lens_params.TryPushBack(value)) return false;
  }
  return true;
}

void ReadCameraSection(const YAML::Node& node, const std::string& file,
                       std::vector<Diagnostic>* problems, CameraConfig* camera) {
  YamlMap map(node, "camera", file, problems);
  std::string model;
  std::vector<double> params;
  std::int64_t width = 0, height = 0;
  const bool has_model = map.GetText("model", Need::kRequired, &model);
  if (map.GetInteger("width", Need::kRequired, 1, kMaxImageSide, &width)) {
    camera->width = static_cast<int>(width);
  }
  if (map.GetInteger("height", Need::kRequired, 1, kMaxImageSide, &height)) {
    camera->height = static_cast<int>(height);
  }
  const bool has_params = map.GetNumbers("params", Need::kRequired, &params);
  std::string field, problem, fix;
  if (has_model && (has_params || !LensModelFromName(model)) &&
      !SetLens(model, params, camera, &field, &problem, &fix)) {
    map.AddProblem(field, problem, fix);
  }
  map.Finish();
}

void CheckPort(const PortConfig& port, const std::string& file, const std::string& prefix, int line,
               std::vector<Diagnostic>* problems) {
  const auto add = [&](const char* field, std::string problem, std::string fix) {
    problems->push_back(
        {Errc::kInvalidArgument, file, prefix + field, std::move(problem), std::move(fix), line});
  };
  if (port.type == PortType::kFlat) {
    const double norm = port.normal.norm();
    if (!(std::abs(norm - 1.0) <= kUnitTolerance)) {
      const Vec3 unit = port.normal / norm;
      add("normal", "is not a unit vector: its length is " + FormatNumber(norm),
          norm > 1e-3 ? "give " + FormatList(unit.data(), 3)
                      : std::string("give the port's direction, [0, 0, 1] when it is not tilted"));
    } else if (port.normal.z() <= 0.0) {
      add("normal", "points backwards", "let it point from the camera towards the water, z > 0");
    }
  }
  if (port.type == PortType::kDome && !(port.center_m.norm() < port.radius_m)) {
    add("center_m",
        "puts the camera outside its dome: the centre is " + FormatNumber(port.center_m.norm()) +
            " m away, the inner radius is " + FormatNumber(port.radius_m) + " m",
        "give a centre nearer than the radius, or a larger radius_m");
  }
}

void CheckPortParams(const PortConfig& port, const std::string& file, const std::string& prefix,
                     int line, std::vector<Diagnostic>* problems) {
  const std::size_t first_problem = problems->size();
  const auto check = [&](const char* field, double value, const Bounds& bounds) {
    if (value >= bounds.low && value <= bounds.high) return;  // false for NaN
    problems->push_back({Errc::kInvalidArgument, file, prefix + field,
                         "is out of range: " + FormatNumber(value), bounds.fix, line});
  };
  if (port.type == PortType::kNone) return;
  if (port.type == PortType::kFlat) check("distance_m", port.distance_m, kDistanceBounds);
  if (port.type == PortType::kDome) check("radius_m", port.radius_m, kRadiusBounds);
  check("thickness_m", port.thickness_m, kThicknessBounds);
  check("index_air", port.index_air, kIndexBounds);
  check("index_glass", port.index_glass, kIndexBounds);
  check("index_water", port.index_water, kIndexBounds);
  if (problems->size() == first_problem) CheckPort(port, file, prefix, line, problems);
}

void ReadPortSection(const YAML::Node& node, const std::string& file,
                     std::vector<Diagnostic>* problems, PortConfig* port) {
  YamlMap map(node, "port", file, problems);
  std::string type;
  if (!map.GetText("type", Need::kRequired, &type)) return;
  const std::size_t first_problem = problems->size();
  PortConfig result;
  if (type == "none") {
    result.type = PortType::kNone;
    // What a port of glass would have means nothing, but it is no harm: files switch back and
    // forth while a rig is being tried.
    for (const char* key :
         {"normal", "distance_m", "center_m", "radius_m", "thickness_m", "index_air", "index_glass",
          "glass", "index_water", "water", "wavelength_nm", "layers"}) {
      map.Ignore(key);
    }
  } else if (type == "flat" || type == "dome") {
    const bool is_flat = type == "flat";
    result.type = is_flat ? PortType::kFlat : PortType::kDome;
    if (is_flat) {
      map.GetVec3("normal", Need::kRequired, &result.normal);
      map.GetNumber("distance_m", Need::kRequired, kDistanceBounds, &result.distance_m);
    } else {
      map.GetVec3("center_m", Need::kRequired, &result.center_m);
      map.GetNumber("radius_m", Need::kRequired, kRadiusBounds, &result.radius_m);
    }
    map.GetNumber("index_air", Need::kOptional, kIndexBounds, &result.index_air);
    double wavelength_nm = WaterConditions().wavelength_nm;
    map.GetNumber("wavelength_nm", Need::kOptional, kWavelengthBounds, &wavelength_nm);
    if (is_flat && map.Has("layers")) {
      ReadLayers(&map, wavelength_nm, &result);
    } else {
      map.GetNumber("thickness_m", Need::kRequired, kThicknessBounds, &result.thickness_m);
      ReadGlass(&map, "index_glass", result.index_air, wavelength_nm, &result.index_glass);
      if (map.Has("layers")) {
        map.Ignore("layers");
        map.AddProblem("layers", "belongs to a flat port", "give a dome thickness_m and one index");
      }
    }
    if (map.Has("water")) {
      ReadWater(&map, result.index_air, wavelength_nm, &result.index_water);
    } else {
      map.GetNumber("index_water", Need::kRequired, kIndexBounds, &result.index_water);
    }
  } else {
    map.AddProblem("type", Quoted(type) + " is not a port", "give flat, dome or none");
    return;
  }
  map.Finish();
  if (problems->size() == first_problem) {
    const YAML::Node blamed = node[result.type == PortType::kFlat ? "normal" : "center_m"];
    CheckPort(result, file, "port.", blamed ? blamed.Mark().line + 1 : node.Mark().line + 1,
              problems);
  }
  *port = result;
}

bool IsCalibmar(const YAML::Node& root) {
  return root.IsMap() && !root["camera"] && root["parameters"] && root["model"];
}

void ReadCalibmar(const YAML::Node& root, const std::string& file,
                  std::vector<Diagnostic>* problems, CameraConfig* camera) {
  YamlMap map(root, "", file, problems);
  std::string model, port_model = "NONE";
  std::vector<double> params, port_params;
  std::int64_t width = 0, height = 0;
  const bool has_lens = map.GetText("model", Need::kRequired, &model) &&
                        map.GetNumbers("parameters", Need::kRequired, &params);
  if (map.GetInteger("width", Need::kRequired, 1, kMaxImageSide, &width)) {
    camera->width = static_cast<int>(width);
  }
  if (map.GetInteger("height", Need::kRequired, 1, kMaxImageSide, &height)) {
    camera->height = static_cast<int>(height);
  }
  std::string field, problem, fix;
  if (has_lens && !SetLens(model, params, camera, &field, &problem, &fix)) {
    map.AddProblem(field == "params" ? "parameters" : field, problem, fix);
  }
  map.GetText("non_svp_model", Need::kOptional, &port_model);
  const bool has_port = port_model != "NONE";
  if (port_model != "FLATPORT" && port_model != "DOMEPORT" && has_port) {
    map.AddProblem("non_svp_model", Quoted(port_model) + " is not a port",
                   "give FLATPORT, DOMEPORT or NONE");
  }
  map.GetNumbers("non_svp_parameters", has_port ? Need::kRequired : Need::kOptional, &port_params);
  map.Finish();
  if (!has_port || !problems->empty()) return;
  if (port_params.size() != static_cast<std::size_t>(kNumPortParams)) {
    map.AddProblem("non_svp_parameters", "has " + std::to_string(port_params.size()) + " elements",
                   "give eight");
    return;
  }
  PortParams values;
  for (int i = 0; i < kNumPortParams; ++i) values[i] = port_params[i];
  camera->port.type = port_model == "FLATPORT" ? PortType::kFlat : PortType::kDome;
  camera->port.SetParams(values);
  CheckPortParams(camera->port, file,
                  "non_svp_parameters: ", root["non_svp_parameters"].Mark().line + 1, problems);
}

}  // namespace rsfm

#include "rsfm/io/colmap_cameras.h"

#include <cmath>
#include <set>

#include "rsfm/io/binary.h"
#include "rsfm/io/camera_yaml.h"
#include "rsfm/io/text.h"

namespace rsfm {
namespace {

constexpr std::int64_t kMaxImageSide = 1 << 16;

// Ids of ports in a cameras.bin with ports.
constexpr std::int32_t kNoColmapPort = -1, kColmapFlatPort = 0, kColmapDomePort = 1;

// Fields behind the lens parameters: nothing, or a port's name and its parameters.
IoStatus ParsePort(const std::vector<std::string_view>& fields, std::size_t first,
                   const std::string& name, int line, PortConfig* port) {
  if (first == fields.size() || fields[first] == "NONE") return {};
  const std::string_view model = fields[first];
  if (model != "FLATPORT" && model != "DOMEPORT") {
    return Fail({Errc::kInvalidArgument, name, "port", Quoted(model) + " is not a port",
                 "write FLATPORT or DOMEPORT with eight parameters, or nothing", line});
  }
  if (fields.size() - first - 1 != static_cast<std::size_t>(kNumPortParams)) {
    return Fail({Errc::kInvalidArgument, name, std::string(model),
                 "has " + std::to_string(fields.size() - first - 1) + " parameters", "give eight",
                 line});
  }
  PortParams params;
  for (int i = 0; i < kNumPortParams; ++i) {
    const auto number = ParseNumber(fields[first + 1 + static_cast<std::size_t>(i)]);
    if (!number || !std::isfinite(*number)) {
      return Fail(
          {Errc::kInvalidArgument, name, std::string(model),
           Quoted(fields[first + 1 + static_cast<std::size_t>(i)]) + " is not a finite number",
           "give eight numbers", line});
    }
    params[i] = *number;
  }
  port->type = model == "FLATPORT" ? PortType::kFlat : PortType::kDome;
  port->SetParams(params);
  std::vector<Diagnostic> problems;
  CheckPortParams(*port, name, std::string(model) + " ", line, &problems);
  if (!problems.empty()) return Fail(problems.front());
  return {};
}

IoExpected<ModelCamera> ParseCameraLine(std::string_view text, const std::string& name, int line) {
  const auto fail = [&](std::string field, std::string problem, std::string fix) {
    return Fail(
        {Errc::kInvalidArgument, name, std::move(field), std::move(problem), std::move(fix), line});
  };
  std::vector<std::string_view> fields;
  SplitBlanks(text, &fields);
  if (fields.size() < 5) {
    return fail("", "is not a camera", "write CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]");
  }
  ModelCamera camera;
  const auto id = ParseInteger(fields[0]);
  const auto width = ParseInteger(fields[2]), height = ParseInteger(fields[3]);
  if (!id || *id <= 0 || *id > UINT32_MAX) {
    return fail("CAMERA_ID", Quoted(fields[0]) + " is not an id", "give a whole number over 0");
  }
  if (!width || !height || *width <= 0 || *height <= 0 || *width > kMaxImageSide ||
      *height > kMaxImageSide) {
    return fail("WIDTH HEIGHT",
                Quoted(std::string(fields[2]) + " " + std::string(fields[3])) + " is no image size",
                "give pixels");
  }
  camera.id = static_cast<std::uint32_t>(*id);
  camera.config.width = static_cast<int>(*width);
  camera.config.height = static_cast<int>(*height);
  const std::string model(fields[1]);
  const auto lens = LensModelFromName(model);
  std::vector<double> params;
  std::size_t i = 4;
  for (; i < fields.size(); ++i) {
    if (lens && params.size() == static_cast<std::size_t>(NumLensParams(*lens))) break;
    const auto number = ParseNumber(fields[i]);
    if (!number || !std::isfinite(*number)) {
      if (!lens) break;
      return fail("PARAMS", Quoted(fields[i]) + " is not a finite number",
                  "give " + std::string(LensParamNames(*lens)));
    }
    params.push_back(*number);
  }
  std::string field, problem, fix;
  if (!SetLens(model, params, &camera.config, &field, &problem, &fix)) {
    return fail(field == "params" ? "PARAMS" : "MODEL", problem, fix);
  }
  if (auto status = ParsePort(fields, i, name, line, &camera.config.port); !status) {
    return Fail(status.error());
  }
  return camera;
}

IoStatus CheckIds(const std::vector<ModelCamera>& cameras, const std::string& name) {
  std::set<std::uint32_t> ids;
  for (const ModelCamera& camera : cameras) {
    if (ids.insert(camera.id).second) continue;
    return Fail({Errc::kCorrupt, name, "camera " + std::to_string(camera.id), "is there twice",
                 "keep one of them"});
  }
  return {};
}

}  // namespace

IoExpected<std::vector<ModelCamera>> ParseColmapCamerasText(const std::string& text,
                                                            const std::string& name) {
  std::vector<ModelCamera> cameras;
  std::string_view rest = text, line;
  for (int number = 1; NextLine(&rest, &line); ++number) {
    line = Trim(line);
    if (line.empty() || line.front() == '#') continue;
    auto camera = ParseCameraLine(line, name, number);
    if (!camera) return Fail(camera.error());
    cameras.push_back(std::move(*camera));
  }
  if (auto status = CheckIds(cameras, name); !status) return Fail(status.error());
  return cameras;
}

namespace {

// A cameras.bin under way: what is wrong is named by camera, byte and field.
struct CameraBytes {
  BinaryReader reader;
  const std::string& name;
  std::uint64_t number = 0;  // of the camera, from 1
  bool is_cut = false;       // all went well up to the end, which came too early

  tl::unexpected<Diagnostic> Fail(Errc code, const std::string& field, const std::string& problem,
                                  std::string fix) const {
    const std::string camera = number > 0 ? "camera " + std::to_string(number) + " " : "";
    return rsfm::Fail({code, name, std::string(Trim(camera + field)),
                       problem + ", at byte " + std::to_string(reader.offset()), std::move(fix)});
  }
  tl::unexpected<Diagnostic> Cut(const std::string& field) {
    is_cut = true;
    return Fail(Errc::kCorrupt, field, "is cut off", "write the file again");
  }
};

IoStatus ReadLens(CameraBytes* bytes, ModelCamera* camera) {
  BinaryReader& reader = bytes->reader;
  std::int32_t model = 0;
  std::uint64_t width = 0, height = 0;
  if (!reader.Read(&camera->id)) return bytes->Cut("CAMERA_ID");
  if (!reader.Read(&model)) return bytes->Cut("MODEL");
  const auto lens = LensModelFromColmapId(model);
  if (!lens) {
    return bytes->Fail(Errc::kUnsupported, "MODEL",
                       "is lens model id " + std::to_string(model) + ", which is not known here",
                       "convert it to one of " + LensModelNames());
  }
  if (!reader.Read(&width) || !reader.Read(&height)) return bytes->Cut("WIDTH HEIGHT");
  constexpr auto kMaxSide = static_cast<std::uint64_t>(kMaxImageSide);
  if (width < 1 || height < 1 || width > kMaxSide || height > kMaxSide) {
    return bytes->Fail(
        Errc::kCorrupt, "WIDTH HEIGHT",
        "is no image size: " + std::to_string(width) + " x " + std::to_string(height),
        "give pixels, from 1 to " + std::to_string(kMaxImageSide));
  }
  std::vector<double> params(static_cast<std::size_t>(NumLensParams(*lens)));
  for (double& value : params) {
    if (!reader.Read(&value)) return bytes->Cut("PARAMS");
    if (!std::isfinite(value)) {
      return bytes->Fail(Errc::kCorrupt, "PARAMS", "has a value that is not finite",
                         "give " + std::string(LensParamNames(*lens)));
    }
  }
  camera->config.width = static_cast<int>(width);
  camera->config.height = static_cast<int>(height);
  std::string field, problem, fix;
  if (!SetLens(std::string(ToString(*lens)), params, &camera->config, &field, &problem, &fix)) {
    return bytes->Fail(Errc::kCorrupt, "PARAMS", problem, fix);
  }
  return {};
}

IoStatus ReadPort(CameraBytes* bytes, PortConfig* port) {
  BinaryReader& reader = bytes->reader;
  std::int32_t model = 0;
  if (!reader.Read(&model)) return bytes->Cut("REFRAC_MODEL");
  if (model == kNoColmapPort) return {};
  if (model != kColmapFlatPort && model != kColmapDomePort) {
    return bytes->Fail(Errc::kCorrupt, "REFRAC_MODEL",
                       "is port id " + std::to_string(model) + ", which is not known here",
                       "give 0 (FLATPORT), 1 (DOMEPORT) or -1 (none)");
  }
  PortParams params;
  for (double& value : params) {
    if (!reader.Read(&value)) return bytes->Cut("REFRAC_PARAMS");
  }
  port->type = model == kColmapFlatPort ? PortType::kFlat : PortType::kDome;
  port->SetParams(params);
  std::vector<Diagnostic> problems;
  CheckPortParams(*port, bytes->name, "REFRAC_PARAMS ", 0, &problems);
  if (problems.empty()) return {};
  const Diagnostic& first = problems.front();
  return bytes->Fail(first.code, first.field, first.problem, first.fix);
}

// How far a reading came, for the better of two explanations of one failure.
struct CameraReading {
  IoExpected<std::vector<ModelCamera>> cameras;
  std::size_t offset = 0;
  bool is_cut = false;
};

CameraReading ReadCameras(const std::string& data, const std::string& name, bool with_port) {
  CameraBytes bytes{BinaryReader(data), name};
  std::vector<ModelCamera> cameras;
  const auto read = [&]() -> IoStatus {
    std::uint64_t count = 0;
    constexpr std::size_t kLeastCameraBytes = 24 + 3 * sizeof(double);
    if (!bytes.reader.Read(&count)) return bytes.Cut("the number of cameras");
    if (!bytes.reader.CanHold(count, kLeastCameraBytes)) {
      bytes.is_cut = true;
      return bytes.Fail(Errc::kCorrupt, "",
                        "is cut off, or not a cameras.bin: it says that it holds " +
                            std::to_string(count) + " cameras",
                        "write the file again");
    }
    for (bytes.number = 1; bytes.number <= count; ++bytes.number) {
      ModelCamera camera;
      if (auto status = ReadLens(&bytes, &camera); !status) return status;
      if (with_port) {
        if (auto status = ReadPort(&bytes, &camera.config.port); !status) return status;
      }
      cameras.push_back(std::move(camera));
    }
    bytes.number = 0;
    if (!bytes.reader.AtEnd()) {
      return bytes.Fail(Errc::kCorrupt, "", "has bytes after its last camera",
                        "write the file again");
    }
    return CheckIds(cameras, name);
  };
  if (auto status = read(); !status)
    return {rsfm::Fail(status.error()), bytes.reader.offset(), bytes.is_cut};
  return {std::move(cameras), bytes.reader.offset(), false};
}

}  // namespace

IoExpected<std::vector<ModelCamera>> ParseColmapCamerasBinary(const std::string& bytes,
                                                              const std::string& name) {
  CameraReading plain = ReadCameras(bytes, name, false);
  if (plain.cameras) return std::move(plain.cameras);
  CameraReading with_port = ReadCameras(bytes, name, true);
  // Neither: the reading that ran into the file's end, or else the one that came farther, says what
  // is wrong with it.
  const bool explains_better =
      with_port.is_cut != plain.is_cut ? with_port.is_cut : with_port.offset > plain.offset;
  const bool is_port_file = with_port.cameras || explains_better;
  return std::move(is_port_file ? with_port.cameras : plain.cameras);
}

std::string FormatColmapCamerasText(const std::vector<ModelCamera>& cameras, bool with_port) {
  std::string text =
      "# Camera list with one line of data per camera:\n#   CAMERA_ID, MODEL, WIDTH, HEIGHT, "
      "PARAMS[]";
  text += with_port ? ", REFRAC_MODEL, REFRAC_PARAMS[]\n" : "\n";
  text += "# Number of cameras: " + std::to_string(cameras.size()) + "\n";
  for (const ModelCamera& camera : cameras) {
    const CameraConfig& config = camera.config;
    text += std::to_string(camera.id) + " " + std::string(ToString(config.lens)) + " " +
            std::to_string(config.width) + " " + std::to_string(config.height);
    for (const double value : config.lens_params) text += " " + FormatNumber(value);
    if (with_port && config.port.type != PortType::kNone) {
      text += config.port.type == PortType::kFlat ? " FLATPORT" : " DOMEPORT";
      for (const double value : config.port.Params()) text += " " + FormatNumber(value);
    }
    text += "\n";
  }
  return text;
}

std::string FormatColmapCamerasBinary(const std::vector<ModelCamera>& cameras, bool with_port) {
  std::string bytes;
  AppendBinary(&bytes, static_cast<std::uint64_t>(cameras.size()));
  for (const ModelCamera& camera : cameras) {
    AppendBinary(&bytes, camera.id);
    AppendBinary(&bytes, static_cast<std::int32_t>(camera.config.lens));
    AppendBinary(&bytes, static_cast<std::uint64_t>(camera.config.width));
    AppendBinary(&bytes, static_cast<std::uint64_t>(camera.config.height));
    for (const double value : camera.config.lens_params) AppendBinary(&bytes, value);
    if (!with_port) continue;
    const PortConfig& port = camera.config.port;
    AppendBinary(&bytes, port.type == PortType::kNone   ? kNoColmapPort
                         : port.type == PortType::kFlat ? kColmapFlatPort
                                                        : kColmapDomePort);
    if (port.type == PortType::kNone) continue;
    for (const double value : port.Params()) AppendBinary(&bytes, value);
  }
  return bytes;
}

}  // namespace rsfm

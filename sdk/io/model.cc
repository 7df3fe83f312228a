#include "rsfm/io/model.h"

#include <algorithm>
#include <set>
#include <unordered_map>

#include "rsfm/io/atomic_output.h"
#include "rsfm/io/colmap_cameras.h"
#include "rsfm/io/colmap_files.h"
#include "rsfm/io/tables.h"
#include "rsfm/io/text.h"

namespace rsfm {
namespace {

namespace fs = std::filesystem;

constexpr std::int64_t kMaxCount = INT32_MAX;

template <class T>
bool IsIndex(std::int32_t index, const std::vector<T>& elements) {
  return index >= 0 && static_cast<std::size_t>(index) < elements.size();
}

template <class Id, class Element, class GetId>
IoExpected<std::unordered_map<Id, std::int32_t>> IndexById(const std::vector<Element>& elements,
                                                           const fs::path& file, const char* kind,
                                                           GetId get_id) {
  if (elements.size() > static_cast<std::size_t>(kMaxCount)) {
    return Fail({Errc::kUnsupported, file.string(), "", "holds too many elements", "split it"});
  }
  std::unordered_map<Id, std::int32_t> index;
  index.reserve(elements.size());
  for (const Element& element : elements) {
    const auto position = static_cast<std::int32_t>(index.size());
    if (index.emplace(get_id(element), position).second) continue;
    return Fail({Errc::kCorrupt, file.string(),
                 std::string(kind) + " " + std::to_string(get_id(element)), "is there twice",
                 "write the model again"});
  }
  return index;
}

// From ids to indices; every reference is checked in both directions.
IoStatus Resolve(std::vector<ColmapImage> images, std::vector<ColmapPoint> points,
                 const fs::path& images_file, const fs::path& points_file, Model* model) {
  const auto camera_index = IndexById<std::uint32_t>(model->cameras, images_file, "camera",
                                                     [](const ModelCamera& c) { return c.id; });
  const auto image_index = IndexById<std::uint32_t>(
      images, images_file, "image", [](const ColmapImage& i) { return i.image.id; });
  const auto point_index = IndexById<std::uint64_t>(
      points, points_file, "point", [](const ColmapPoint& p) { return p.point.id; });
  if (!camera_index) return Fail(camera_index.error());
  if (!image_index) return Fail(image_index.error());
  if (!point_index) return Fail(point_index.error());
  const auto corrupt = [](const fs::path& file, std::string field, std::string problem) {
    return Fail({Errc::kCorrupt, file.string(), std::move(field), std::move(problem),
                 "write the model again: its files do not belong together"});
  };
  for (ColmapImage& raw : images) {
    ModelImage& image = raw.image;
    const auto camera = camera_index->find(raw.camera_id);
    if (camera == camera_index->end()) {
      return corrupt(images_file, "image " + std::to_string(image.id),
                     "has camera " + std::to_string(raw.camera_id) + ", which does not exist");
    }
    image.camera = camera->second;
    image.points.assign(image.features.size(), kNoPoint);
    model->images.push_back(std::move(image));
  }
  for (ColmapPoint& raw : points) {
    const std::string field = "point " + std::to_string(raw.point.id);
    const auto this_point = static_cast<std::int32_t>(model->points.size());
    for (const auto& [image_id, feature] : raw.track) {
      const auto image = image_index->find(image_id);
      const bool is_there =
          image != image_index->end() &&
          feature < images[static_cast<std::size_t>(image->second)].point_ids.size();
      if (!is_there) {
        return corrupt(points_file, field,
                       "is seen by feature " + std::to_string(feature) + " of image " +
                           std::to_string(image_id) + ", which does not exist");
      }
      const auto i = static_cast<std::size_t>(image->second);
      if (images[i].point_ids[feature] != raw.point.id) {
        return corrupt(points_file, field,
                       "is not the point that image " + std::to_string(image_id) + " names");
      }
      model->images[i].points[feature] = this_point;
      raw.point.track.push_back({image->second, static_cast<std::int32_t>(feature)});
    }
    model->points.push_back(std::move(raw.point));
  }
  for (std::size_t i = 0; i < images.size(); ++i) {
    for (std::size_t f = 0; f < images[i].point_ids.size(); ++f) {
      const std::uint64_t id = images[i].point_ids[f];
      if (id == kNoColmapPoint || model->images[i].points[f] != kNoPoint) continue;
      return corrupt(images_file, "image " + std::to_string(model->images[i].id),
                     "names point " + std::to_string(id) + ", whose track does not have it");
    }
  }
  return {};
}

// rig.yaml and times.csv beside COLMAP's files.
IoStatus ReadCompanions(const fs::path& folder, Model* model) {
  std::error_code error;
  if (fs::exists(folder / "rig.yaml", error)) {
    auto rig = ReadRig(folder / "rig.yaml");
    if (!rig) return Fail(rig.error());
    model->rig = std::move(*rig);
    for (ModelCamera& camera : model->cameras) {
      if (camera.config.port.type == PortType::kNone) camera.config.port = model->rig.camera.port;
    }
  }
  if (!model->cameras.empty()) model->rig.camera = model->cameras.front().config;
  if (!fs::exists(folder / "times.csv", error)) return {};
  const auto times = ReadImageTimes(folder / "times.csv");
  if (!times) return Fail(times.error());
  std::unordered_map<std::string_view, Utime> utime_of_name;
  for (const ImageTime& time : *times) utime_of_name[time.image] = time.utime;
  for (ModelImage& image : model->images) {
    const auto found = utime_of_name.find(image.name);
    if (found != utime_of_name.end()) image.utime = found->second;
  }
  return {};
}

// Ids of all elements: their own where they have one, free ones else.
template <class Id, class Element>
std::vector<Id> AssignIds(const std::vector<Element>& elements) {
  std::set<Id> used;
  std::vector<Id> ids;
  for (const Element& element : elements) {
    const bool is_free = element.id != 0 && used.insert(static_cast<Id>(element.id)).second;
    ids.push_back(is_free ? static_cast<Id>(element.id) : Id{0});
  }
  Id next = used.empty() ? 1 : static_cast<Id>(*used.rbegin() + 1);
  for (Id& id : ids) {
    if (id == 0) id = next++;
  }
  return ids;
}

IoStatus WriteTimes(const Model& model, const fs::path& folder) {
  std::vector<ImageTime> times;
  for (const ModelImage& image : model.images) {
    if (image.utime != 0) times.push_back({image.name, image.utime});
  }
  if (times.empty()) return {};
  std::sort(times.begin(), times.end(),
            [](const ImageTime& a, const ImageTime& b) { return a.utime < b.utime; });
  return WriteImageTimes(times, folder / "times.csv");
}

void FillColmap(const Model& model, const std::vector<std::uint32_t>& camera_ids,
                std::vector<ColmapImage>* images, std::vector<ColmapPoint>* points) {
  const auto image_ids = AssignIds<std::uint32_t>(model.images);
  const auto point_ids = AssignIds<std::uint64_t>(model.points);
  for (std::size_t i = 0; i < model.images.size(); ++i) {
    ColmapImage raw;
    raw.image = model.images[i];
    raw.image.id = image_ids[i];
    raw.camera_id = camera_ids[static_cast<std::size_t>(raw.image.camera)];
    for (const std::int32_t point : raw.image.points) {
      raw.point_ids.push_back(point == kNoPoint ? kNoColmapPoint
                                                : point_ids[static_cast<std::size_t>(point)]);
    }
    images->push_back(std::move(raw));
  }
  for (std::size_t p = 0; p < model.points.size(); ++p) {
    ColmapPoint raw;
    raw.point = model.points[p];
    raw.point.id = point_ids[p];
    for (const TrackElement& element : raw.point.track) {
      raw.track.emplace_back(image_ids[static_cast<std::size_t>(element.image)],
                             static_cast<std::uint32_t>(element.feature));
    }
    points->push_back(std::move(raw));
  }
}

}  // namespace

Status Validate(const Model& model) {
  std::size_t num_observations = 0;
  for (const ModelImage& image : model.images) {
    if (!IsIndex(image.camera, model.cameras)) return Fail(Errc::kInvalidArgument, "image.camera");
    if (image.points.size() != image.features.size()) {
      return Fail(Errc::kInvalidArgument, "image.points");
    }
    for (const std::int32_t point : image.points) {
      if (point == kNoPoint) continue;
      if (!IsIndex(point, model.points)) return Fail(Errc::kInvalidArgument, "image.points");
      ++num_observations;
    }
  }
  for (std::size_t p = 0; p < model.points.size(); ++p) {
    for (const TrackElement& element : model.points[p].track) {
      if (!IsIndex(element.image, model.images)) return Fail(Errc::kInvalidArgument, "point.track");
      const ModelImage& image = model.images[static_cast<std::size_t>(element.image)];
      if (!IsIndex(element.feature, image.points) ||
          image.points[static_cast<std::size_t>(element.feature)] != static_cast<std::int32_t>(p)) {
        return Fail(Errc::kInvalidArgument, "point.track");
      }
      --num_observations;  // may wrap; the end decides
    }
  }
  if (num_observations != 0) return Fail(Errc::kInvalidArgument, "point.track");
  return {};
}

IoExpected<Model> ReadModel(const fs::path& folder) {
  std::error_code error;
  const bool is_binary = fs::exists(folder / "cameras.bin", error);
  const std::string extension = is_binary ? ".bin" : ".txt";
  if (!is_binary && !fs::exists(folder / "cameras.txt", error)) {
    return Fail({Errc::kNotFound, folder.string(), "",
                 "is not a model: it has no cameras.bin or "
                 "cameras.txt",
                 "give a folder with COLMAP's three files"});
  }
  const fs::path cameras_file = folder / ("cameras" + extension);
  const fs::path images_file = folder / ("images" + extension);
  const fs::path points_file = folder / ("points3D" + extension);
  const auto cameras_text = ReadWholeFile(cameras_file);
  if (!cameras_text) return Fail(cameras_text.error());
  const auto images_text = ReadWholeFile(images_file);
  if (!images_text) return Fail(images_text.error());
  const auto points_text = ReadWholeFile(points_file);
  if (!points_text) return Fail(points_text.error());

  auto cameras = is_binary ? ParseColmapCamerasBinary(*cameras_text, cameras_file.string())
                           : ParseColmapCamerasText(*cameras_text, cameras_file.string());
  if (!cameras) return Fail(cameras.error());
  auto images = is_binary ? ParseColmapImagesBinary(*images_text, images_file.string())
                          : ParseColmapImagesText(*images_text, images_file.string());
  if (!images) return Fail(images.error());
  auto points = is_binary ? ParseColmapPointsBinary(*points_text, points_file.string())
                          : ParseColmapPointsText(*points_text, points_file.string());
  if (!points) return Fail(points.error());

  Model model;
  model.cameras = std::move(*cameras);
  if (auto status =
          Resolve(std::move(*images), std::move(*points), images_file, points_file, &model);
      !status) {
    return Fail(status.error());
  }
  if (auto status = ReadCompanions(folder, &model); !status) return Fail(status.error());
  return model;
}

namespace {

bool AreSame(const PortConfig& a, const PortConfig& b) {
  if (a.type != b.type || a.Params() != b.Params()) return false;
  return std::equal(a.outer_layers.begin(), a.outer_layers.end(), b.outer_layers.begin(),
                    b.outer_layers.end(), [](const PortLayer& c, const PortLayer& d) {
                      return c.thickness_m == d.thickness_m && c.index == d.index;
                    });
}

// What rig.yaml and, with ports in it, COLMAP's cameras file can hold.
IoStatus CheckPorts(const std::vector<ModelCamera>& cameras, const PortConfig& port,
                    const fs::path& folder, bool with_port) {
  for (const ModelCamera& camera : cameras) {
    if (AreSame(camera.config.port, port)) continue;
    return Fail({Errc::kUnsupported, folder.string(), "port",
                 "the model's cameras have different ports, and rig.yaml holds one",
                 "write one model per port"});
  }
  if (!with_port || port.outer_layers.empty()) return {};
  return Fail({Errc::kUnsupported, folder.string(), "port.layers",
               "a port of several layers has no place in colmap_underwater's files",
               "write colmap-txt or colmap-bin: rig.yaml beside them keeps the layers"});
}

}  // namespace

IoStatus WriteModelFiles(const Model& model, const fs::path& folder, ModelFormat format) {
  if (const Status status = Validate(model); !status) {
    return Fail({Errc::kInvalidArgument, folder.string(), status.error().where,
                 "the model does not hold together", ""});
  }
  Rig rig = model.rig;
  std::vector<ModelCamera> cameras = model.cameras;
  const auto camera_ids = AssignIds<std::uint32_t>(cameras);
  for (std::size_t i = 0; i < cameras.size(); ++i) cameras[i].id = camera_ids[i];
  if (!cameras.empty()) rig.camera = cameras.front().config;
  const bool is_binary =
      format == ModelFormat::kColmapBinary || format == ModelFormat::kColmapUnderwaterBinary;
  const bool with_port =
      format == ModelFormat::kColmapUnderwater || format == ModelFormat::kColmapUnderwaterBinary;
  if (auto status = CheckPorts(cameras, rig.camera.port, folder, with_port); !status) return status;
  std::vector<ColmapImage> images;
  std::vector<ColmapPoint> points;
  FillColmap(model, camera_ids, &images, &points);

  const auto write = [&](const char* stem, const std::string& content) {
    return WriteFileAtomically(folder / (std::string(stem) + (is_binary ? ".bin" : ".txt")),
                               content);
  };
  IoStatus status = write("cameras", is_binary ? FormatColmapCamerasBinary(cameras, with_port)
                                               : FormatColmapCamerasText(cameras, with_port));
  if (status) {
    status = write("images",
                   is_binary ? FormatColmapImagesBinary(images) : FormatColmapImagesText(images));
  }
  if (status) {
    status = write("points3D",
                   is_binary ? FormatColmapPointsBinary(points) : FormatColmapPointsText(points));
  }
  if (status) status = WriteRig(rig, folder / "rig.yaml");
  if (status) status = WriteTimes(model, folder);
  return status;
}

IoStatus WriteModel(const Model& model, const fs::path& folder, ModelFormat format) {
  auto output = AtomicFolder::Create(folder, Existing::kReplace);
  if (!output) return Fail(output.error());
  if (auto status = WriteModelFiles(model, output->aside(), format); !status) return status;
  return output->Commit();
}

}  // namespace rsfm

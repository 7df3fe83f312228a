// COLMAP's models, text and binary. The input is "t" or "b", then cameras, images and points3D,
// between them the line "-----".
#include "rsfm/io/model.h"
#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace rsfm;
  if (size == 0) return 0;
  std::string_view text = AsText(data + 1, size - 1);
  const std::string suffix = data[0] == 't' ? ".txt" : ".bin";
  const std::filesystem::path folder = FuzzFolder() / "model";
  std::filesystem::remove_all(folder);
  std::filesystem::create_directories(folder);
  for (const char* name : {"cameras", "images", "points3D"}) {
    constexpr std::string_view kBetween = "\n-----\n";
    const std::size_t end = text.find(kBetween);
    WriteFuzzFile(folder / (name + suffix), text.substr(0, end));
    text = end == std::string_view::npos ? std::string_view() : text.substr(end + kBetween.size());
  }
  const auto model = ReadModel(folder);
  if (!model) return 0;
  for (const ModelPoint& point : model->points) Require(point.xyz.allFinite());
  for (const ModelImage& image : model->images)
    Require(std::abs(image.camera_from_world.rotation.norm() - 1.0) < 1e-6);
  return 0;
}

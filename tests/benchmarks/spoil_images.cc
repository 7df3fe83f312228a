// What goes wrong with a camera, put into the images of a mission that was rendered without it.
//
//   spoil_images MISSION OUT COUNT {KIND FROM_S TO_S}…
//
// writes the mission's first COUNT images (0: all), spoiled between those seconds since the first.
// Kinds: black (lens cap, strobe that does not fire), sand (nothing but noise on a smooth bottom),
// particles (a field 30 px wide of bright specks that stay where they are in the image).
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "rsfm/io/mission.h"
#include "rsfm/io/tables.h"

namespace rsfm {
namespace {

constexpr double kSandBlur_px = 12.0, kNoise = 3.0;
constexpr int kFieldWidth_px = 30, kSpecks = 60;

struct Fault {
  const char* kind;
  double from_s, to_s;
};

void MakeSand(cv::Mat* image, cv::RNG* rng) {
  cv::GaussianBlur(*image, *image, {}, kSandBlur_px);
  cv::Mat noise(image->size(), CV_16SC3);
  rng->fill(noise, cv::RNG::NORMAL, 0.0, kNoise);
  cv::add(*image, noise, *image, cv::noArray(), CV_8U);
}

// The same at every call: the field does not move.
void AddParticles(cv::Mat* image) {
  cv::RNG rng(5);
  const int left = (image->cols - kFieldWidth_px) / 2;
  for (int i = 0; i < kSpecks; ++i) {
    const cv::Point at(left + rng.uniform(2, kFieldWidth_px - 2), rng.uniform(2, image->rows - 2));
    cv::circle(*image, at, rng.uniform(1, 3), cv::Scalar::all(rng.uniform(170, 250)), cv::FILLED,
               cv::LINE_AA);
  }
}

void Spoil(const Fault& fault, cv::Mat* image, cv::RNG* rng) {
  if (std::strcmp(fault.kind, "black") == 0) image->setTo(0);
  if (std::strcmp(fault.kind, "sand") == 0) MakeSand(image, rng);
  if (std::strcmp(fault.kind, "particles") == 0) AddParticles(image);
}

int Run(const std::filesystem::path& mission, const std::filesystem::path& out, std::size_t count,
        const std::vector<Fault>& faults) {
  namespace fs = std::filesystem;
  auto images = ReadImageTimes(mission / kImagesFile);
  if (!images || images->empty()) return 1;
  if (count > 0 && count < images->size()) images->resize(count);
  fs::create_directories(out / kImagesFolder);
  fs::copy_file(mission / kRigFile, out / kRigFile, fs::copy_options::overwrite_existing);
  if (!WriteImageTimes(*images, out / kImagesFile)) return 1;
  cv::RNG rng(9);
  for (const ImageTime& entry : *images) {
    const double seconds = SecondsFromUs(entry.utime - images->front().utime);
    const fs::path from = mission / kImagesFolder / entry.image,
                   to = out / kImagesFolder / entry.image;
    cv::Mat image;
    for (const Fault& fault : faults) {
      if (seconds < fault.from_s || seconds >= fault.to_s) continue;
      if (image.empty()) image = cv::imread(from.string());
      if (image.empty()) return 1;
      Spoil(fault, &image, &rng);
    }
    if (image.empty()) {
      fs::copy_file(from, to, fs::copy_options::overwrite_existing);
    } else if (!cv::imwrite(to.string(), image, {cv::IMWRITE_JPEG_QUALITY, 93})) {
      return 1;
    }
  }
  return 0;
}

}  // namespace
}  // namespace rsfm

int main(int argc, char** argv) {
  std::vector<rsfm::Fault> faults;
  for (int i = 4; i + 2 < argc; i += 3)
    faults.push_back({argv[i], std::atof(argv[i + 1]), std::atof(argv[i + 2])});
  if (argc < 4 || (argc - 4) % 3 != 0) {
    std::fprintf(stderr, "spoil_images MISSION OUT COUNT {black|sand|particles FROM_S TO_S}...\n");
    return 2;
  }
  for (const rsfm::Fault& fault : faults) {
    const std::string kind = fault.kind;
    if (kind == "black" || kind == "sand" || kind == "particles") continue;
    std::fprintf(stderr, "'%s' is none of black, sand, particles\n", fault.kind);
    return 2;
  }
  return rsfm::Run(argv[1], argv[2], static_cast<std::size_t>(std::atoi(argv[3])), faults);
}

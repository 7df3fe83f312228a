// The front ends' speed at 1280 x 960, one thread, each with its ratio to OpenCV in the same run.
//
// The scene is a strip of random texture that moves past by a few pixels an image, with the noise
// of a camera; every image is drawn before the clock starts.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <opencv2/features2d.hpp>
#include <opencv2/video/tracking.hpp>
#include <vector>

#include "rsfm/base/rng.h"
#include "rsfm/mapping/frame_gate.h"
#include "rsfm/mapping/front_end.h"
#include "rsfm/mapping/incremental_mapper.h"
#include "rsfm/mapping/point_tracker.h"
#include "tests/mapping/feature_world.h"

namespace rsfm {
namespace {

constexpr int kWidth = 1280, kHeight = 960, kImages = 60;
const Vec2 kStep(-11.3, 4.2);  // px an image

double Seconds(auto&& f) {
  const auto start = std::chrono::steady_clock::now();
  f();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

double Percentile(std::vector<double> values, double part) {
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(part * static_cast<double>(values.size() - 1))];
}

// Blobs of all sizes over each other, in a world larger than the image.
std::vector<std::vector<std::uint8_t>> MakeImages(int count, const Vec2& step) {
  Rng rng(11);
  struct Blob {
    Vec2 at;
    double sigma, height;
  };
  std::vector<Blob> blobs;
  for (int i = 0; i < 14000; ++i)
    blobs.push_back({{rng.Uniform(-100.0, kWidth + 800.0), rng.Uniform(-400.0, kHeight + 100.0)},
                     rng.Uniform(1.2, 5.0),
                     rng.Uniform(-45.0, 45.0)});
  std::vector<std::vector<std::uint8_t>> images;
  std::vector<float> light(kWidth * kHeight);
  for (int k = 0; k < count; ++k) {
    std::fill(light.begin(), light.end(), 110.0f);
    for (const Blob& blob : blobs) {
      const Vec2 at = blob.at + k * step;
      const auto reach = static_cast<int>(3.5 * blob.sigma) + 1;
      const auto cx = static_cast<int>(at.x()), cy = static_cast<int>(at.y());
      for (int y = std::max(0, cy - reach); y < std::min(kHeight, cy + reach); ++y) {
        for (int x = std::max(0, cx - reach); x < std::min(kWidth, cx + reach); ++x) {
          const double squared = (Vec2(x + 0.5, y + 0.5) - at).squaredNorm();
          light[static_cast<std::size_t>(y * kWidth + x)] += static_cast<float>(
              blob.height * std::exp(-0.5 * squared / (blob.sigma * blob.sigma)));
        }
      }
    }
    std::vector<std::uint8_t> bytes;
    for (const float value : light)
      bytes.push_back(
          static_cast<std::uint8_t>(std::clamp(value + rng.Uniform(-2.0, 2.0) + 0.5, 0.0, 255.0)));
    images.push_back(std::move(bytes));
  }
  return images;
}

const std::vector<std::vector<std::uint8_t>>& Images() {
  static const auto images = MakeImages(kImages, kStep);
  return images;
}

ImageView View(const std::vector<std::uint8_t>& bytes) {
  return {bytes.data(), kWidth, kHeight, kWidth, 1};
}

// Points followed forward and back from one image to the next, pyramids included.
void Follow(benchmark::State& state) {
  MapperOptions options;
  const int count = static_cast<int>(state.range(0));
  options.max_features = count;
  std::vector<cv::Point2f> places;
  PointTracker tracker(options, kWidth, kHeight, count);
  const auto& images = Images();
  double ours = std::numeric_limits<double>::infinity();
  std::size_t kept = 0;
  for (auto _ : state) {
    tracker.Clear();
    tracker.Follow(images[0].data(), kWidth, {});
    Rng rng(2);
    places.clear();
    for (int i = 0; i < count; ++i) {
      places.emplace_back(static_cast<float>(rng.Uniform(40.0, kWidth - 40.0)),
                          static_cast<float>(rng.Uniform(40.0, kHeight - 40.0)));
      tracker.Add({places.back().x, places.back().y});
    }
    ours = std::min(ours, Seconds([&] { tracker.Follow(images[1].data(), kWidth, {}); }));
    kept = tracker.points().size();
  }
  cv::setNumThreads(1);
  const cv::Mat first(kHeight, kWidth, CV_8UC1, const_cast<std::uint8_t*>(images[0].data()));
  const cv::Mat second(kHeight, kWidth, CV_8UC1, const_cast<std::uint8_t*>(images[1].data()));
  std::vector<cv::Mat> from, to;
  std::vector<cv::Point2f> found, back;
  std::vector<std::uint8_t> status;
  std::vector<float> errors;
  const cv::Size window(options.track_window_px, options.track_window_px);
  const cv::TermCriteria stop(3, 20, 0.01);
  cv::buildOpticalFlowPyramid(first, from, window, 4);
  double theirs = std::numeric_limits<double>::infinity();
  for (int i = 0; i < 5; ++i) {
    theirs = std::min(
        theirs, Seconds([&] {
          cv::buildOpticalFlowPyramid(second, to, window, 4);
          cv::calcOpticalFlowPyrLK(from, to, places, found, status, errors, window, 4, stop);
          cv::calcOpticalFlowPyrLK(to, from, found, back, status, errors, window, 4, stop);
        }));
  }
  state.counters["kept"] = static_cast<double>(kept) / count;
  state.counters["ms"] = 1e3 * ours;
  state.counters["ms_opencv"] = 1e3 * theirs;
  state.counters["ratio"] = theirs / ours;
}

AnyCamera Camera() {
  CameraConfig config = TestCamera(TestPort::kFlat).config();
  config.width = kWidth;
  config.height = kHeight;
  return AnyCamera::Create(config).value();
}

// Gate, front end and mapper, image by image: what it takes until the pose is there, of all images;
// what makes a keyframe of one after that; and the window's adjustment.
void Video(benchmark::State& state) {
  MapperOptions options;
  options.rhythm = Rhythm::kVideo;
  options.contrast_limit = static_cast<double>(state.range(0));
  std::vector<double> front_end_ms, pose_ms, keyframe_ms, adjust_ms;
  int num_placed = 0;
  for (auto _ : state) {
    const auto front_end = std::move(*FrontEnd::Create(options, kWidth, kHeight));
    const auto mapper = std::move(*IncrementalMapper::Create(options, Camera(), Rigid3()));
    FrameGate gate(kWidth, kHeight);
    Utime utime = 0;
    for (const auto& image : Images()) {
      utime += 100'000;
      Expected<FrameObservations> frame = Fail(Errc::kNotFound);
      const double front_end_s = Seconds([&] {
        if (gate.Check(View(image), utime) == FrameVerdict::kGood)
          frame = front_end->Process(
              View(image), utime,
              {.want_descriptors = mapper->wants_descriptors(), .may_describe_later = true});
      });
      if (!frame) return state.SkipWithError("an image was refused");
      const double step_s = Seconds([&] { benchmark::DoNotOptimize(mapper->Step(*frame)); });
      if (mapper->state() == MapperState::kTracking) {
        ++num_placed;
        front_end_ms.push_back(1e3 * front_end_s);
        pose_ms.push_back(1e3 * (front_end_s + step_s));
        const double describe_s = Seconds([&] {
          const auto described = front_end->Describe();
          if (described && *described) benchmark::DoNotOptimize(mapper->AddKeyframe(**described));
        });
        if (mapper->needs_adjustment()) keyframe_ms.push_back(1e3 * describe_s);
      }
      if (mapper->needs_adjustment())
        adjust_ms.push_back(1e3 * Seconds([&] { mapper->AdjustWindow(); }));
    }
  }
  if (keyframe_ms.empty() || num_placed < 50) return state.SkipWithError("frames were lost");
  const auto report = [&](const std::string& name, const std::vector<double>& ms) {
    state.counters[name + "_ms_p50"] = Percentile(ms, 0.5);
    state.counters[name + "_ms_p99"] = Percentile(ms, 0.99);
  };
  report("front_end", front_end_ms);
  report("pose", pose_ms);
  report("keyframe", keyframe_ms);
  report("adjust", adjust_ms);
  state.counters["keyframe_part"] =
      static_cast<double>(keyframe_ms.size()) / static_cast<double>(pose_ms.size());
}

void Stills(benchmark::State& state) {
  MapperOptions options;
  options.descriptor = static_cast<DescriptorType>(state.range(0));
  options.sift_first_octave = static_cast<int>(state.range(1));
  const auto front_end = std::move(*FrontEnd::Create(options, kWidth, kHeight));
  std::vector<double> ms;
  std::size_t features = 0;
  for (auto _ : state) {
    for (int i = 0; i < 10; ++i) {
      ms.push_back(1e3 * Seconds([&] {
                     const auto frame = front_end->Process(
                         View(Images()[static_cast<std::size_t>(6 * i)]), i + 1, {});
                     features = frame ? frame->features.size() : 0;
                   }));
    }
  }
  state.counters["ms_p50"] = Percentile(ms, 0.5);
  state.counters["ms_p99"] = Percentile(ms, 0.99);
  state.counters["features"] = static_cast<double>(features);
  state.SetLabel(std::string(ToString(options.descriptor)));
}

BENCHMARK(Follow)->Arg(300)->Arg(600)->Unit(benchmark::kMillisecond);
BENCHMARK(Video)->Arg(0)->Arg(3)->Unit(benchmark::kMillisecond)->Iterations(1);
BENCHMARK(Stills)
    ->ArgNames({"descriptor", "first_octave"})
    ->Args({static_cast<int>(DescriptorType::kSift), -1})
    ->Args({static_cast<int>(DescriptorType::kSift), 0})
    ->Args({static_cast<int>(DescriptorType::kOrb), -1})
    ->Unit(benchmark::kMillisecond)
    ->Iterations(1);

}  // namespace
}  // namespace rsfm

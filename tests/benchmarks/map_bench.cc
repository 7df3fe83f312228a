// The mapper's speed, each figure with its ratio to a plain implementation in the same run.
//
// The baseline of matching is what one writes first: descriptors as vectors of float on the heap,
// every distance in full, no guidance. The baseline of a frame is its feature extraction (OpenCV's
// SIFT), which no mapper on descriptors can do without.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <vector>

#include "rsfm/mapping/front_end.h"
#include "rsfm/mapping/incremental_mapper.h"
#include "tests/mapping/blob_image.h"
#include "tests/mapping/feature_world.h"

namespace rsfm {
namespace {

double SecondsSince(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

template <class F>
double BestSeconds(int repetitions, F&& f) {
  double best = std::numeric_limits<double>::infinity();
  for (int i = 0; i < repetitions; ++i) {
    const auto start = std::chrono::steady_clock::now();
    f();
    best = std::min(best, SecondsSince(start));
  }
  return best;
}

using PlainDescriptors = std::vector<std::vector<float>>;

PlainDescriptors ToPlain(const DescriptorView& view) {
  PlainDescriptors plain;
  for (int i = 0; i < view.count; ++i) plain.emplace_back(view.Row(i), view.Row(i) + 128);
  return plain;
}

// Mutual nearest neighbours with the ratio test, the plain way.
std::vector<std::pair<int, int>> PlainMatch(const PlainDescriptors& query,
                                            const PlainDescriptors& train, float max_ratio) {
  std::vector<int> nearest_query(train.size(), -1);
  std::vector<float> nearest_distance(train.size(), std::numeric_limits<float>::max());
  std::vector<std::pair<int, int>> candidates, matches;
  for (std::size_t i = 0; i < query.size(); ++i) {
    std::vector<std::pair<float, int>> distances;
    for (std::size_t j = 0; j < train.size(); ++j) {
      float sum = 0.0f;
      for (std::size_t k = 0; k < 128; ++k)
        sum += (query[i][k] - train[j][k]) * (query[i][k] - train[j][k]);
      distances.push_back({std::sqrt(sum), static_cast<int>(j)});
      if (sum < nearest_distance[j]) {
        nearest_distance[j] = sum;
        nearest_query[j] = static_cast<int>(i);
      }
    }
    std::partial_sort(distances.begin(), distances.begin() + 2, distances.end());
    if (distances[0].first < max_ratio * distances[1].first)
      candidates.push_back({static_cast<int>(i), distances[0].second});
  }
  for (const auto& [i, j] : candidates) {
    if (nearest_query[static_cast<std::size_t>(j)] == i) matches.push_back({i, j});
  }
  return matches;
}

FeatureWorldOptions WorldOptions(int num_features) {
  FeatureWorldOptions options;
  options.num_points = 16 * num_features;
  options.max_features = num_features;
  return options;
}

void Matching(benchmark::State& state) {
  const int count = static_cast<int>(state.range(0));
  const AnyCamera camera = TestCamera(TestPort::kFlat);
  const FeatureWorld world(WorldOptions(count));
  const FeatureFrame a = world.See(camera, (SurveyBody(3.0) * DownwardCamera()).Inverse(), 1);
  const FeatureFrame b = world.See(camera, (SurveyBody(4.0) * DownwardCamera()).Inverse(), 2);
  const DescriptorView query = a.View(1).descriptors, train = b.View(2).descriptors;
  const PlainDescriptors plain_query = ToPlain(query), plain_train = ToPlain(train);
  std::size_t plain_matches = 0;
  const double baseline =
      BestSeconds(3, [&] { plain_matches = PlainMatch(plain_query, plain_train, 0.85f).size(); });

  DescriptorMatcher matcher(count);
  std::vector<DescriptorMatch> matches(static_cast<std::size_t>(count));
  int found = 0;
  double ours = std::numeric_limits<double>::infinity();
  for (auto _ : state) {
    ours =
        std::min(ours, BestSeconds(1, [&] { found = matcher.Match(query, train, 0.85, matches); }));
  }
  if (static_cast<std::size_t>(found) != plain_matches) state.SkipWithError("results differ");
  state.counters["ratio"] = baseline / ours;
  state.counters["ms"] = 1e3 * ours;
  state.counters["ms_baseline"] = 1e3 * baseline;
}

// A survey of strobed stills: the whole of Step, every frame a keyframe.
void Step(benchmark::State& state) {
  const int count = static_cast<int>(state.range(0));
  constexpr int kFrames = 30;
  MapperOptions options;
  options.max_features = count;
  const AnyCamera camera = TestCamera(TestPort::kFlat);
  const FeatureWorld world(WorldOptions(count));
  std::vector<FeatureFrame> frames;
  std::vector<PlainDescriptors> plain;
  for (int i = 0; i < kFrames; ++i) {
    frames.push_back(world.See(camera, (SurveyBody(i) * DownwardCamera()).Inverse(), i));
    plain.push_back(ToPlain(frames.back().View(1).descriptors));
  }
  const double plain_match = BestSeconds(2, [&] { PlainMatch(plain[5], plain[6], 0.85f); });

  double best = std::numeric_limits<double>::infinity();
  int placed = 0;
  for (auto _ : state) {
    auto mapper = std::move(*IncrementalMapper::Create(options, camera, DownwardCamera()));
    placed = 0;
    best = std::min(best, BestSeconds(1, [&] {
                      for (int i = 0; i < kFrames; ++i) {
                        const auto report = mapper->Step(
                            frames[static_cast<std::size_t>(i)].View(1000000 * (i + 1)));
                        placed += report && report->state == MapperState::kTracking;
                      }
                    }));
  }
  if (placed < kFrames - 2) state.SkipWithError("frames were lost");
  state.counters["frames_per_second"] = kFrames / best;
  state.counters["ms_frame"] = 1e3 * best / kFrames;
  // The plain way has to match each frame with as many keyframes before it can do anything else.
  const double baseline = plain_match * options.match_keyframes;
  state.counters["ratio"] = baseline / (best / kFrames);
  state.counters["ms_baseline"] = 1e3 * baseline;
}

// Front end and mapper together, on images; the baseline is the extraction alone.
void Frame(benchmark::State& state) {
  MapperOptions options;
  options.rhythm = state.range(0) == 0 ? Rhythm::kStills : Rhythm::kVideo;
  options.max_features = 600;
  const AnyCamera camera = [] {
    CameraConfig config = TestCamera(TestPort::kFlat).config();
    config.width = BlobImage::kWidth;
    config.height = BlobImage::kHeight;
    return AnyCamera::Create(config).value();
  }();
  std::vector<BlobImage> images;
  for (int i = 0; i < 10; ++i) images.push_back(BlobImage::Texture(i * Vec2(3.0, 1.0)));
  MapperOptions stills = options;
  stills.rhythm = Rhythm::kStills;
  const auto extractor =
      std::move(*FrontEnd::Create(stills, BlobImage::kWidth, BlobImage::kHeight));
  const double baseline = BestSeconds(3, [&] {
    for (const BlobImage& image : images)
      benchmark::DoNotOptimize(extractor->Process(image.View(), 1, {.want_descriptors = true}));
  });
  double best = std::numeric_limits<double>::infinity();
  for (auto _ : state) {
    const auto front_end =
        std::move(*FrontEnd::Create(options, BlobImage::kWidth, BlobImage::kHeight));
    const auto mapper = std::move(*IncrementalMapper::Create(options, camera, Rigid3()));
    best = std::min(best, BestSeconds(1, [&] {
                      Utime utime = 0;
                      for (const BlobImage& image : images) {
                        const auto frame = front_end->Process(image.View(), ++utime, {});
                        if (frame) benchmark::DoNotOptimize(mapper->Step(*frame));
                      }
                    }));
  }
  const auto count = static_cast<double>(images.size());
  state.counters["frames_per_second"] = count / best;
  state.counters["ms_frame"] = 1e3 * best / count;
  state.counters["ms_baseline"] = 1e3 * baseline / count;
  state.counters["ratio"] = baseline / best;
}

BENCHMARK(Matching)->Name("Match/sift")->Arg(1000)->Arg(2000)->Unit(benchmark::kMillisecond);
BENCHMARK(Step)->Name("Step/stills")->Arg(1000)->Arg(2000)->Unit(benchmark::kMillisecond);
BENCHMARK(Frame)->Name("Frame/stills_video")->Arg(0)->Arg(1)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace rsfm

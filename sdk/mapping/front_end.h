// From an image to features: the only place where OpenCV works, and where its pixels (centre of the
// top-left pixel at 0, 0) become ours (0.5, 0.5).
//
// stills  every image is searched and described on its own
// video   points are tracked from image to image (pyramidal Lucas-Kanade, forward and back); when
//         too much has moved or been lost, the image becomes a keyframe: points are sought afresh
//         in the grid's empty cells, and all are described
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>

#include "rsfm/base/error.h"
#include "rsfm/mapping/feature.h"

namespace rsfm {

// What is known of an image before it is looked at.
struct FrameHints {
  // Descriptors, though the image would be no keyframe.
  bool want_descriptors = false;
  // Video: a keyframe may come back without them, as any other image; Describe then makes it one.
  // So its pose need not wait for what is sought and described.
  bool may_describe_later = false;
  // Video: where each feature of the image before is expected in this one, in that image's order;
  // not finite where nothing is known. Empty: expect the motion of the image before.
  std::span<const Vec2> expected_px = {};
};

// Tracks that ended, by why. Stills have none.
struct FrontEndCounters {
  std::int64_t lost = 0;        // not found again, or not back where they came from
  std::int64_t stationary = 0;  // fixed to the camera while the scene moved
  std::int64_t drifting = 0;    // moving by themselves: particles, fish
};

class FrontEnd {
 public:
  // kInvalidArgument for a bad option, `where` naming it, or an image size below 32 px.
  static Expected<std::unique_ptr<FrontEnd>> Create(const MapperOptions& options, int width_px,
                                                    int height_px);
  virtual ~FrontEnd() = default;

  // Features of the next image. What is returned lies in the front end's memory until the next
  // call. Descriptors are there for stills, for a video's keyframes, and wherever they are wanted.
  //   kInvalidArgument  "size": not the size given to Create; "image": no data or channels
  //   kUnsupported      OpenCV refused; the front end then starts afresh with the next image
  // Allocates only inside OpenCV and for OpenCV's own containers: bounded by the image's size and
  // max_features.
  virtual Expected<FrameObservations> Process(const ImageView& image, Utime utime,
                                              const FrameHints& hints) = 0;

  // The image of the last Process again, which is still there, as the keyframe it is: with
  // descriptors, and new points after those of before. None where that was no keyframe, or had its
  // descriptors. Errors as of Process.
  virtual Expected<std::optional<FrameObservations>> Describe() { return std::nullopt; }

  virtual FrontEndCounters counters() const { return {}; }

  // Heap held between calls, OpenCV's scratch memory apart.
  virtual std::size_t bytes() const = 0;

 protected:
  FrontEnd() = default;
  FrontEnd(const FrontEnd&) = delete;
  FrontEnd& operator=(const FrontEnd&) = delete;
};

}  // namespace rsfm

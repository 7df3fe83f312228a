// The flags that refine and reconstruct share: what becomes of the camera and of its mount, more
// matches.
#pragma once

#include <CLI/CLI.hpp>
#include <array>

#include "tools/offline/navigation_fit.h"

namespace rsfm {

inline constexpr const char* kGuidedHelp =
    "search the images again along the epipolar curves once the poses are known: more matches";

inline void AddCameraFlags(CLI::App* verb, bool* refine_port, bool* refine_lens, bool* uwpinhole) {
  CLI::Option* port =
      verb->add_flag("--refine-port", *refine_port, "flat: normal and distance; dome: centre");
  verb->add_flag("--refine-lens", *refine_lens, "focal length, principal point and distortion");
  verb->add_flag("--uwpinhole", *uwpinhole,
                 "the usual approximation, for comparison: no port, a lens made to absorb it")
      ->excludes(port);
}

inline std::array<CLI::Option*, 2> AddMountFlags(CLI::App* verb, MountOptions* mount) {
  return {verb->add_flag("--refine-mount", mount->mount,
                         "how the camera is mounted: lever arm and angles of body_from_camera"),
          verb->add_flag("--refine-clock", mount->clock,
                         "by how much navigation's clock is ahead of the images'")};
}

}  // namespace rsfm

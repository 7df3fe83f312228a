// The flags that refine and reconstruct share: what becomes of the camera, more matches.
#pragma once

#include <CLI/CLI.hpp>

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

}  // namespace rsfm

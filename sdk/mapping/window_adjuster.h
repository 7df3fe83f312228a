// Window bundle adjustment over the map: the newest keyframes and the landmarks they see move;
// older keyframes that see the same landmarks hold them; navigation weighs in.
#pragma once

#include "rsfm/estimation/window_ba.h"
#include "rsfm/mapping/map.h"
#include "rsfm/mapping/nav_aid.h"

namespace rsfm {

class WindowAdjuster {
 public:
  // The only place that allocates.
  static Expected<WindowAdjuster> Create(const MapperOptions& options, const AnyCamera& camera);

  // The same camera in other water; allocates nothing.
  void SetCamera(const AnyCamera& camera) noexcept { camera_ = camera; }

  // Adjusts the newest `count` placed keyframes. `nav` is null where the world is not NED. On error
  // the map is as it was.
  Expected<WindowBaReport> Adjust(Map* map, int count, const NavAid* nav) noexcept;

  // The keyframes that moved in the last Adjust, oldest first.
  std::span<const SlotId> window() const { return window_.span(); }
  std::size_t bytes() const { return ba_.bytes() + landmarks_.bytes(); }

 private:
  WindowAdjuster(const MapperOptions& options, const AnyCamera& camera, WindowBa ba);
  void SelectWindow(const Map& map, int count) noexcept;
  void AddLandmarks(const Map& map, int min_observations) noexcept;
  int BaIndexOf(const Map& map, SlotId keyframe) noexcept;
  void AddPriors(const Map& map, const NavAid& nav) noexcept;
  void WriteBack(Map* map) noexcept;

  MapperOptions options_;
  AnyCamera camera_;
  WindowBa ba_;
  FixedVector<SlotId> window_;
  FixedVector<SlotId> landmarks_;    // in the order in which ba_ has them
  FixedVector<int> index_of_;        // per keyframe slot: its index in ba_, -1 where not in it
  FixedVector<std::uint8_t> added_;  // per landmark slot
  SlotId newest_fixed_;
  int num_fixed_ = 0;
};

}  // namespace rsfm

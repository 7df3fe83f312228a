#include "rsfm/mapping/loop_correction.h"

namespace rsfm {

Rigid3 CorrectMap(const LoopCloser& loops, SlotId left, bool is_ned, Map* map,
                  WindowAdjuster* adjuster) noexcept {
  const std::int32_t left_id = map->keyframe(left).id;
  const Vec3 left_at = map->keyframe(left).camera_from_world.OriginOfTarget();
  Rigid3 moved = loops.Correction(left_id);
  if (is_ned) {  // attitude and gravity stay
    const Quat turn = ExpSo3(Vec3(0.0, 0.0, LogSo3(moved.rotation).z()));
    moved = {turn, moved * left_at - turn * left_at};
  }
  const auto correction = [&](std::int32_t id) {
    return id < left_id ? loops.Correction(id) : moved;
  };
  map->landmarks().ForEach([&](SlotId, Landmark& landmark) {
    if (landmark.observations.empty()) return;
    const Keyframe& newest = map->keyframe(landmark.observations.back().keyframe);
    landmark.point_in_world = correction(newest.id) * landmark.point_in_world;
    landmark.is_changed = true;
  });
  for (const SlotId id : map->keyframes()) {
    Keyframe& keyframe = map->keyframe(id);
    if (keyframe.is_placed)
      keyframe.camera_from_world = keyframe.camera_from_world * correction(keyframe.id).Inverse();
  }
  adjuster->Move(moved);
  return moved;
}

}  // namespace rsfm

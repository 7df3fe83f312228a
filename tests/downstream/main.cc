// Reads a camera file, projects a point and back-projects its pixel.
#include <cstdio>

#include "rsfm/io/rig.h"
#include "rsfm/refraction/any_camera.h"

int main(int argc, char** argv) {
  if (argc != 2) return 2;
  const auto rig = rsfm::ReadRig(argv[1]);
  if (!rig) {
    std::fprintf(stderr, "%s\n", rsfm::ToString(rig.error()).c_str());
    return 2;
  }
  const auto camera = rsfm::AnyCamera::Create(rig->camera);
  if (!camera) return 2;
  const rsfm::Vec3 point(0.3, -0.2, 2.0);
  rsfm::Vec2 pixel;
  rsfm::Ray3 ray;
  if (camera->Project(point, &pixel) != rsfm::Projection::kOk) return 1;
  if (camera->Backproject(pixel, &ray) != rsfm::Projection::kOk) return 1;
  std::printf("pixel %.3f %.3f miss %.1e m\n", pixel.x(), pixel.y(), ray.Distance(point));
  return ray.Distance(point) < 1e-9 ? 0 : 1;
}

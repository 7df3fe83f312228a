// Images of a scene through a real port: every sample's ray in water comes from the camera's own
// back-projection, so refraction is exact and independent of the forward projection.
#pragma once

#include <memory>
#include <span>

#include "rsfm/base/rigid3.h"
#include "rsfm/refraction/any_camera.h"
#include "tools/simulator/ray_caster.h"
#include "tools/simulator/water.h"

namespace rsfm::simulator {

// Row by row, 8-bit blue, green, red: OpenCV's order.
struct RenderedImage {
  int width = 0;
  int height = 0;
  std::vector<std::uint8_t> bgr;
};

struct SensorOptions {
  int samples_per_pixel = 4;  // a square number: 1, 4, 9, 16, 25
  bool motion_blur = false;   // a pixel's samples are taken at moments all over the exposure
  double exposure_s = 0.004;  // of motion_blur alone; image times are its middle
  bool noise = true;
  double full_well_electrons = 15000.0;  // shot noise: white is this many electrons
  double read_noise_electrons = 12.0;
  bool vignetting = true;
  double vignetting_at_corner = 0.25;  // share of the light lost there, growing with radius squared
  bool gamma = true;                   // the sRGB curve; off: linear
  double grey = 0.2;                   // linear level of a mid-grey floor at the exposed range
  std::uint64_t seed = 1;
};

class Renderer {
 public:
  // Traces the camera's rays once (on `num_threads`). Everything passed must outlive the renderer.
  Renderer(const AnyCamera& camera, const Scene& scene, const RayCaster& caster, const Water& water,
           const SensorOptions& options, int num_threads);

  // Thread-safe; a function of the arguments and the options alone. `frame` seeds the noise.
  void Render(const Rigid3& world_from_camera, std::uint32_t frame, RenderedImage* image) const {
    Render(std::span(&world_from_camera, 1), frame, image);
  }
  // The same of a moving camera: its poses in order of time, evenly over the exposure. Each of a
  // pixel's samples sees one of them, the first sample any, the others in turn.
  void Render(std::span<const Rigid3> world_from_camera, std::uint32_t frame,
              RenderedImage* image) const;

  // Distance in water [m] along the ray of each pixel's centre, from the port's outer surface; 0
  // where nothing is seen. Row by row.
  void RenderRange(const Rigid3& world_from_camera, std::vector<float>* range_m) const;

  // Share of the samples that have a ray at all.
  double CoveredFraction() const { return covered_fraction_; }

 private:
  struct Scratch;

  void MakeRays(int num_threads);
  void MakeNoiseTable();
  void ShadePixel(const Eigen::Matrix3f& camera_from_scene, std::size_t first_sample,
                  std::size_t first_point, std::size_t num_points, const RaySoa& rays,
                  Scratch* scratch, Rgb* pixel) const;
  void RenderRow(std::span<const Rigid3> scene_from_camera, std::uint32_t frame, int row,
                 Scratch* scratch, std::uint8_t* bgr) const;
  void Develop(const Rgb& linear, int x, int y, std::uint32_t frame, std::uint8_t* bgr) const;

  const AnyCamera& camera_;
  const Scene& scene_;
  const RayCaster& caster_;
  const Water& water_;
  SensorOptions options_;
  int samples_ = 4;
  std::vector<RaySoa> rows_;  // in the camera frame; [row], pixel by pixel, sample by sample
  double covered_fraction_ = 0.0;
  float sample_angle_rad_ = 0.0f;
  std::vector<float> gaussian_;           // quantiles of the standard normal
  std::vector<std::uint8_t> tone_curve_;  // linear to 8 bit
};

}  // namespace rsfm::simulator

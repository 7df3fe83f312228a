// The picture of a refraction check: the error of the best-fit pinhole over the image.
#pragma once

#include <string>

#include "tools/check/refraction_effect.h"
#include "tools/report/canvas.h"

namespace rsfm {

// Size of the figure, px.
Vec2 HeatMapSize(const AnyCamera& camera);
// Draws into a canvas of that size. `title` and `verdict` are one line each.
void DrawHeatMap(const AnyCamera& camera, const RefractionEffect& effect, const std::string& title,
                 const std::string& verdict, Canvas* canvas);

}  // namespace rsfm

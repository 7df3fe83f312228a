// Every lens x port, as one closed variant. A new lens is a line in camera/lens_list.h, a new port
// a line here.
#pragma once

#include <variant>

#include "rsfm/camera/lens_list.h"
#include "rsfm/refraction/dome_port.h"
#include "rsfm/refraction/flat_port.h"
#include "rsfm/refraction/no_port.h"
#include "rsfm/refraction/refractive_camera.h"

namespace rsfm {

template <class... Lenses>
auto MakeCameraVariant(LensTypeList<Lenses...>)
    -> std::variant<RefractiveCamera<Lenses, NoPort>..., RefractiveCamera<Lenses, FlatPort>...,
                    RefractiveCamera<Lenses, DomePort>...>;

using CameraVariant = decltype(MakeCameraVariant(AllLenses{}));

}  // namespace rsfm

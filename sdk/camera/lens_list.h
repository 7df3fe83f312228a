// The lens models, each a composition of parts: one line here and one in lens_model.{h,cc} adds a
// model.
#pragma once

#include "rsfm/camera/composed_lens.h"
#include "rsfm/camera/division_distortion.h"
#include "rsfm/camera/equidistant_base.h"
#include "rsfm/camera/eucm_distortion.h"
#include "rsfm/camera/fov_distortion.h"
#include "rsfm/camera/no_distortion.h"
#include "rsfm/camera/perspective_base.h"
#include "rsfm/camera/polynomial_distortion.h"
#include "rsfm/camera/rad_tan_thin_prism_distortion.h"
#include "rsfm/camera/rational_distortion.h"

namespace rsfm {

using Radial1 =
    PolynomialDistortion<PolynomialLayout{.num_params = 1, .num_radial = 1, .radial = {0}}>;
using Radial2 =
    PolynomialDistortion<PolynomialLayout{.num_params = 2, .num_radial = 2, .radial = {0, 1}}>;
using Radial4 = PolynomialDistortion<PolynomialLayout{
    .num_params = 4, .num_radial = 4, .radial = {0, 1, 2, 3}}>;
using BrownConrady = PolynomialDistortion<PolynomialLayout{
    .num_params = 4, .num_radial = 2, .radial = {0, 1}, .tangential = 2}>;
using ThinPrism = PolynomialDistortion<PolynomialLayout{
    .num_params = 8, .num_radial = 4, .radial = {0, 1, 4, 5}, .tangential = 2, .prism = 6}>;
// Metashape's own order: its p1 is OpenCV's p2.   [Agisoft Metashape Professional manual, appendix
// D, fisheye cameras]
using MetashapeDistortion = PolynomialDistortion<PolynomialLayout{.num_params = 6,
                                                                  .num_radial = 4,
                                                                  .radial = {0, 1, 2, 3},
                                                                  .tangential = 4,
                                                                  .tangential_swapped = true}>;

using SimplePinhole = ComposedLens<LensModel::kSimplePinhole, PerspectiveBase, NoDistortion, 1>;
using Pinhole = ComposedLens<LensModel::kPinhole, PerspectiveBase, NoDistortion, 2>;
using SimpleRadial = ComposedLens<LensModel::kSimpleRadial, PerspectiveBase, Radial1, 1>;
using Radial = ComposedLens<LensModel::kRadial, PerspectiveBase, Radial2, 1>;
using OpenCV = ComposedLens<LensModel::kOpenCV, PerspectiveBase, BrownConrady, 2>;
using OpenCVFisheye = ComposedLens<LensModel::kOpenCVFisheye, EquidistantBase, Radial4, 2>;
using FullOpenCV = ComposedLens<LensModel::kFullOpenCV, PerspectiveBase, RationalDistortion, 2>;
using Fov = ComposedLens<LensModel::kFov, PerspectiveBase, FovDistortion, 2>;
using SimpleRadialFisheye =
    ComposedLens<LensModel::kSimpleRadialFisheye, EquidistantBase, Radial1, 1>;
using RadialFisheye = ComposedLens<LensModel::kRadialFisheye, EquidistantBase, Radial2, 1>;
using ThinPrismFisheye = ComposedLens<LensModel::kThinPrismFisheye, EquidistantBase, ThinPrism, 2>;
using RadTanThinPrismFisheye =
    ComposedLens<LensModel::kRadTanThinPrismFisheye, EquidistantBase, RadTanThinPrismDistortion, 2>;
using SimpleDivision =
    ComposedLens<LensModel::kSimpleDivision, PerspectiveBase, DivisionDistortion, 1>;
using Division = ComposedLens<LensModel::kDivision, PerspectiveBase, DivisionDistortion, 2>;
using SimpleFisheye = ComposedLens<LensModel::kSimpleFisheye, EquidistantBase, NoDistortion, 1>;
using Fisheye = ComposedLens<LensModel::kFisheye, EquidistantBase, NoDistortion, 2>;
using Eucm = ComposedLens<LensModel::kEucm, PerspectiveBase, EucmDistortion, 2>;
using MetashapeFisheye =
    ComposedLens<LensModel::kMetashapeFisheye, EquidistantBase, MetashapeDistortion, 2>;

template <class... Lenses>
struct LensTypeList {};

// In the groups in which they are compiled (lens_ops_*.cc).
using PinholeLenses = LensTypeList<SimplePinhole, Pinhole, Fov, SimpleDivision, Division, Eucm>;
using RadialLenses = LensTypeList<SimpleRadial, Radial, OpenCV, FullOpenCV>;
using FisheyeLenses =
    LensTypeList<SimpleFisheye, Fisheye, SimpleRadialFisheye, RadialFisheye, OpenCVFisheye>;
using PrismLenses = LensTypeList<ThinPrismFisheye, RadTanThinPrismFisheye, MetashapeFisheye>;

template <class... Lists>
struct JoinLenses;
template <class... Ls>
struct JoinLenses<LensTypeList<Ls...>> {
  using type = LensTypeList<Ls...>;
};
template <class... As, class... Bs, class... Rest>
struct JoinLenses<LensTypeList<As...>, LensTypeList<Bs...>, Rest...>
    : JoinLenses<LensTypeList<As..., Bs...>, Rest...> {};
using AllLenses = JoinLenses<PinholeLenses, RadialLenses, FisheyeLenses, PrismLenses>::type;

}  // namespace rsfm

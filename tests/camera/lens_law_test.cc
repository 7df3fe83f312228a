// The laws of a lens, for every model of the list.
#include <ceres/jet.h>
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "rsfm/base/rng.h"
#include "rsfm/camera/lens_list.h"
#include "tests/support/malloc_trap.h"

namespace rsfm {
namespace {

// Plausible distortion of either sign for every model, by the names of its parameters.
template <class L>
typename L::Params RandomParams(Rng* rng, double strength) {
  typename L::Params params;
  std::string_view names = LensParamNames(L::kModel);
  for (double& value : params) {
    const std::string_view name = names.substr(0, names.find(' '));
    names.remove_prefix(std::min(names.size(), name.size() + 1));
    if (name.starts_with("f")) {
      value = rng->Uniform(900.0, 1100.0);
    } else if (name == "cx" || name == "cy") {
      value = rng->Uniform(500.0, 520.0);
    } else if (name == "omega") {
      value = strength * rng->Uniform(0.1, 0.9);
    } else if (name == "alpha") {
      value = strength == 0.0 ? 0.0 : rng->Uniform(0.1, 0.9);
    } else if (name == "beta") {
      value = rng->Uniform(0.5, 1.5);
    } else if (name.starts_with("p") || name.starts_with("s")) {
      value = strength * rng->Uniform(-0.002, 0.002);
    } else if (name == "k" || (name == "k1" && L::kModel != LensModel::kRadTanThinPrismFisheye) ||
               name == "k0") {
      value = strength * rng->Uniform(-0.15, 0.15);
    } else {
      value = strength * rng->Uniform(-0.01, 0.01);
    }
  }
  return params;
}

template <class L>
class LensTest : public ::testing::Test {
 protected:
  static constexpr int kRigs = 20;

  // f(lens, direction) over random lenses and a grid of directions that holds the optical axis and
  // its neighbourhood.
  template <class F>
  void ForEachDirection(F&& f) {
    Rng rng(11);
    for (int rig = 0; rig < kRigs; ++rig) {
      const L lens(RandomParams<L>(&rng, rig == 0 ? 0.0 : 1.0));
      for (int ring = 0; ring <= 12; ++ring) {
        const double angle = ring == 0 ? 0.0 : ring == 1 ? 1e-9 : ring == 2 ? 1e-5 : 0.06 * ring;
        for (int spoke = 0; spoke < (ring == 0 ? 1 : 5); ++spoke) {
          const double azimuth = 1.3 * spoke + 0.1;
          f(lens,
            rng.Uniform(0.1, 10.0) * Vec3(std::sin(angle) * std::cos(azimuth),
                                          std::sin(angle) * std::sin(azimuth), std::cos(angle)));
        }
      }
    }
  }
};

template <class List>
struct AsTestTypes;
template <class... Ls>
struct AsTestTypes<LensTypeList<Ls...>> {
  using type = ::testing::Types<Ls...>;
};
TYPED_TEST_SUITE(LensTest, AsTestTypes<AllLenses>::type);

TYPED_TEST(LensTest, NamesAndNumbersAgree) {
  EXPECT_EQ(NumLensParams(TypeParam::kModel), TypeParam::kNumParams);
  EXPECT_EQ(LensModelFromName(ToString(TypeParam::kModel)), TypeParam::kModel);
  EXPECT_EQ(LensModelFromColmapId(static_cast<int>(TypeParam::kModel)), TypeParam::kModel);
  EXPECT_LE(TypeParam::kNumParams, kMaxLensParams);
}

TYPED_TEST(LensTest, UnprojectInvertsProject) {
  int inside = 0;
  this->ForEachDirection([&](const TypeParam& lens, const Vec3& direction) {
    Vec2 pixel;
    if (lens.Project(direction, &pixel) != LensStatus::kOk) return;
    ++inside;
    Vec3 back = Vec3::Zero();
    ASSERT_EQ(lens.Unproject(pixel, &back), LensStatus::kOk) << direction.transpose();
    EXPECT_NEAR(back.norm(), 1.0, 1e-15);
    EXPECT_LT((back - direction.normalized()).norm(), 1e-12) << direction.transpose();
  });
  EXPECT_GT(inside, 1000);
}

TYPED_TEST(LensTest, JacobiansMatchAutomaticDifferentiation) {
  using Jet = ceres::Jet<double, 3 + TypeParam::kNumParams>;
  this->ForEachDirection([&](const TypeParam& lens, const Vec3& direction) {
    Vec2 pixel, plain;
    LensJacobian<TypeParam::kNumParams> jacobian;
    if (lens.Project(direction, &pixel, &jacobian) != LensStatus::kOk) return;
    ASSERT_EQ(lens.Project(direction, &plain), LensStatus::kOk);
    EXPECT_LT((pixel - plain).norm(), 1e-12 * (1.0 + plain.norm()));
    Vec3T<Jet> d(Jet(direction.x(), 0), Jet(direction.y(), 1), Jet(direction.z(), 2));
    Jet params[TypeParam::kNumParams];
    for (int i = 0; i < TypeParam::kNumParams; ++i) params[i] = Jet(lens.params()[i], 3 + i);
    Vec2T<Jet> jet;
    ASSERT_TRUE(TypeParam::template ProjectT<Jet>(params, d, &jet));
    for (int row = 0; row < 2; ++row) {
      EXPECT_NEAR(jet[row].a, pixel[row], 1e-9);
      const Vec3 expected = jet[row].v.template head<3>();
      // Automatic differentiation of a quotient of small numbers loses digits next to the axis;
      // ours does not.
      EXPECT_LT((jacobian.d_pixel_d_direction.row(row).transpose() - expected).norm(),
                1e-6 * (1.0 + expected.norm()))
          << direction.transpose();
      const Eigen::Matrix<double, TypeParam::kNumParams, 1> of_params =
          jet[row].v.template tail<TypeParam::kNumParams>();
      EXPECT_LT((jacobian.d_pixel_d_params.row(row).transpose() - of_params).norm(),
                1e-7 * (1.0 + of_params.norm()))
          << direction.transpose();
    }
  });
}

TYPED_TEST(LensTest, OnlyTheDirectionCounts) {
  this->ForEachDirection([&](const TypeParam& lens, const Vec3& direction) {
    Vec2 pixel, scaled;
    Mat23 jacobian;
    if (lens.Project(direction, &pixel, &jacobian) != LensStatus::kOk) return;
    ASSERT_EQ(lens.Project(7.0 * direction, &scaled), LensStatus::kOk);
    EXPECT_LT((pixel - scaled).norm(), 1e-9);
    EXPECT_LT((jacobian * direction).norm(), 1e-9);  // homogeneous of degree zero
  });
}

TYPED_TEST(LensTest, BeyondTheFoldIsAStatusNotAPixel) {
  // Walking outwards, the radius grows as long as the status is good, and never comes back after it
  // has gone bad.
  Rng rng(12);
  for (int rig = 0; rig < 200; ++rig) {
    const TypeParam lens(RandomParams<TypeParam>(&rng, 4.0));
    double last_radius = -1.0;
    bool ended = false;
    for (double angle = 0.0; angle < 3.1; angle += 0.01) {
      Vec2 pixel;
      const bool ok =
          lens.Project(Vec3(std::sin(angle), 0.0, std::cos(angle)), &pixel) == LensStatus::kOk;
      if (!ok) ended = true;
      if (ok && TypeParam::kModel != LensModel::kThinPrismFisheye &&
          TypeParam::kModel != LensModel::kOpenCV && TypeParam::kModel != LensModel::kFullOpenCV &&
          TypeParam::kModel != LensModel::kRadTanThinPrismFisheye &&
          TypeParam::kModel != LensModel::kMetashapeFisheye) {
        EXPECT_FALSE(ended) << angle;
        const double radius =
            (pixel -
             Vec2(lens.params()[TypeParam::kNumParams > 3 ? NumFocalLengths(TypeParam::kModel) : 1],
                  lens.params()[NumFocalLengths(TypeParam::kModel) + 1]))
                .norm();
        EXPECT_GT(radius, last_radius) << angle;
        last_radius = radius;
      }
    }
  }
}

TYPED_TEST(LensTest, AnyFiniteInputGivesAStatusAndNoNaN) {
  Rng rng(13);
  const double scales[] = {0.0, 1e-300, 1e-30, 1e-3, 1.0, 1e3, 1e30, 1e200};
  const auto number = [&] { return scales[rng.Index(8)] * rng.Uniform(-1.0, 1.0); };
  for (int i = 0; i < 20'000; ++i) {
    typename TypeParam::Params params = RandomParams<TypeParam>(&rng, 1.0);
    if (i % 2 == 1) {
      for (int k = NumFocalLengths(TypeParam::kModel); k < TypeParam::kNumParams; ++k)
        params[k] = number();
    }
    const TypeParam lens(params);
    Vec2 pixel(-7.0, -7.0);
    Mat23 jacobian;
    if (lens.Project(Vec3(number(), number(), number()), &pixel, &jacobian) == LensStatus::kOk) {
      if (i % 2 == 0) {
        ASSERT_FALSE(pixel.hasNaN())
            << lens.params()[0] << " " << lens.params()[1] << " " << lens.params()[3];
      }
    } else {
      EXPECT_EQ(pixel, Vec2(-7.0, -7.0));  // untouched
    }
    Vec3 direction(5.0, 5.0, 5.0);
    if (lens.Unproject(Vec2(number(), number()), &direction) == LensStatus::kOk) {
      EXPECT_FALSE(direction.hasNaN());
    } else {
      EXPECT_EQ(direction, Vec3(5.0, 5.0, 5.0));
    }
  }
}

TYPED_TEST(LensTest, HotPathDoesNotAllocate) {
  Rng rng(14);
  const auto params = RandomParams<TypeParam>(&rng, 1.0);
  MallocTrap trap;
  const TypeParam lens(params);
  Vec2 pixel = Vec2::Zero();
  Vec3 direction;
  LensJacobian<TypeParam::kNumParams> jacobian;
  EXPECT_EQ(lens.Project(Vec3(0.1, 0.2, 1.0), &pixel, &jacobian), LensStatus::kOk);
  EXPECT_EQ(lens.Unproject(pixel, &direction), LensStatus::kOk);
  EXPECT_EQ(trap.count(), 0u);
}

}  // namespace
}  // namespace rsfm

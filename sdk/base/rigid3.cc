#include "rsfm/base/rigid3.h"

namespace rsfm {

Rigid3 ExpSe3(const Vec6& tangent) noexcept {
  const Vec3 rotation = tangent.head<3>();
  return {ExpSo3(rotation), LeftJacobianSo3(rotation) * tangent.tail<3>()};
}

Vec6 LogSe3(const Rigid3& transform) noexcept {
  const Vec3 rotation = LogSo3(transform.rotation);
  Vec6 tangent;
  tangent << rotation, LeftJacobianInverseSo3(rotation) * transform.translation;
  return tangent;
}

Mat6 AdjointSe3(const Rigid3& transform) noexcept {
  const Mat3 rotation = transform.rotation.toRotationMatrix();
  Mat6 adjoint = Mat6::Zero();
  adjoint.topLeftCorner<3, 3>() = rotation;
  adjoint.bottomRightCorner<3, 3>() = rotation;
  adjoint.bottomLeftCorner<3, 3>() = Hat(transform.translation) * rotation;
  return adjoint;
}

Rigid3 Interpolate(const Rigid3& start, const Rigid3& end, double fraction) noexcept {
  const Vec3 turn = LogSo3(end.rotation * start.rotation.conjugate());
  return {(ExpSo3(fraction * turn) * start.rotation).normalized(),
          (1.0 - fraction) * start.translation + fraction * end.translation};
}

}  // namespace rsfm

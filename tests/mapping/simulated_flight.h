// A simulated mission flown by the mapper, and how far off its poses are.
#pragma once

#include <Eigen/Dense>
#include <cmath>
#include <vector>

#include "tests/mapping/simulated_mission.h"
#include "tests/support/malloc_trap.h"

namespace rsfm {

struct Flight {
  std::vector<StepReport> reports;
  std::vector<Vec3> found, truth;  // the body, where there is a pose
  std::vector<double> nees;        // of the frames with a pose in a NED world
  // The same of parts: along north and east, down, about the level axes, about the vertical.
  std::vector<Vec4> partial_nees;  // of 2, 1, 2 and 1 degrees of freedom
  std::size_t heap_calls = 0;
  int num_tracking = 0;
};

// The error of a pose with its covariance: (position, rotation about the world's axes). The world's
// place is that of the first pose.
inline Vec6 PoseError(const BodyPose& pose, const Rigid3& truth, const Vec3& offset) {
  Vec6 error;
  error.head<3>() = pose.world_from_body.translation - truth.translation - offset;
  error.tail<3>() = LogSo3(pose.world_from_body.rotation * truth.rotation.conjugate());
  return error;
}
inline double Nees(const Vec6& error, const Mat6& covariance) {
  return error.dot(covariance.ldlt().solve(error));
}
inline Vec4 PartialNees(const Vec6& error, const Mat6& covariance) {
  const auto of_pair = [&](int i) {
    return error.segment<2>(i).dot(covariance.block<2, 2>(i, i).inverse() * error.segment<2>(i));
  };
  const auto of_one = [&](int i) { return error[i] * error[i] / covariance(i, i); };
  return {of_pair(0), of_one(2), of_pair(3), of_one(5)};
}

inline Flight Fly(const SimulatedMission& mission, IncrementalMapper* mapper, int num_frames) {
  mission.FeedNav(&mapper->nav().buffer());
  Flight flight;
  Vec3 offset = Vec3::Zero();
  for (int frame = 0; frame < num_frames; ++frame) {
    const FeatureFrame seen = mission.See(frame);
    const FrameObservations view = seen.View(mission.UtimeOf(frame), mission.IsKeyframe(frame));
    MallocTrap trap;
    const auto report = mapper->Step(view);
    flight.heap_calls += trap.count();
    if (!report) continue;
    flight.reports.push_back(*report);
    flight.num_tracking += report->state == MapperState::kTracking;
    if (!report->has_pose) continue;
    const BodyPose body =
        ToBodyPose(report->camera_from_world, report->covariance, DownwardCamera());
    const Rigid3 truth = mission.Body(mission.TimeOf(frame));
    if (flight.nees.empty()) {
      offset = body.world_from_body.translation - truth.translation;
      offset.z() = 0.0;
    }
    flight.found.push_back(body.world_from_body.translation);
    flight.truth.push_back(truth.translation);
    if (!report->world_is_ned) continue;
    const Vec6 error = PoseError(body, truth, offset);
    flight.nees.push_back(Nees(error, body.covariance));
    flight.partial_nees.push_back(PartialNees(error, body.covariance));
  }
  return flight;
}

// After the best turn about the vertical and shift.
inline double AlignedRmse(const std::vector<Vec3>& found, const std::vector<Vec3>& truth) {
  Vec3 mean_found = Vec3::Zero(), mean_truth = Vec3::Zero();
  for (std::size_t i = 0; i < found.size(); ++i) {
    mean_found += found[i] / static_cast<double>(found.size());
    mean_truth += truth[i] / static_cast<double>(found.size());
  }
  double sine = 0.0, cosine = 0.0;
  for (std::size_t i = 0; i < found.size(); ++i) {
    const Vec3 a = found[i] - mean_found, b = truth[i] - mean_truth;
    cosine += a.x() * b.x() + a.y() * b.y();
    sine += a.x() * b.y() - a.y() * b.x();
  }
  const Quat turn = ExpSo3(Vec3(0, 0, std::atan2(sine, cosine)));
  double sum = 0.0;
  for (std::size_t i = 0; i < found.size(); ++i)
    sum += (turn * (found[i] - mean_found) - (truth[i] - mean_truth)).squaredNorm();
  return std::sqrt(sum / static_cast<double>(found.size()));
}

inline std::unique_ptr<IncrementalMapper> MakeMapper(const SimulatedMission& mission,
                                                     const MapperOptions& options) {
  return IncrementalMapper::Create(options, mission.camera(), DownwardCamera()).value();
}

// Dead reckoning from the same sensors, frame by frame.
inline double DeadReckonedRmse(const SimulatedMission& mission, const NavAid& nav, int num_frames) {
  std::vector<Vec3> found{Vec3::Zero()}, truth{mission.Body(0.0).translation};
  for (int frame = 1; frame < num_frames; ++frame) {
    const auto motion =
        nav.buffer().DeadReckon(mission.UtimeOf(frame - 1), mission.UtimeOf(frame), nav.defaults());
    if (!motion) break;
    found.push_back(found.back() + motion->displacement_ned_m);
    truth.push_back(mission.Body(mission.TimeOf(frame)).translation);
  }
  return AlignedRmse(found, truth);
}

}  // namespace rsfm

// The on-board estimator over surveys of 300 m without images: position against the truth, against
// dead reckoning from the same sensors, and against its own covariance.
//
//   estimator_bench [SEEDS [CASE]]    a line per case: means over SEEDS (default 3) flights
//
// NEES: mean over all poses, 6 where it is consistent; then its parts along north and east (2),
// down (1), about the level axes (2) and about the vertical (1). The last pose's alone after "end".
#include <cstdio>
#include <cstdlib>
#include <string>

#include "tests/mapping/simulated_flight.h"

namespace rsfm {
namespace {

struct Case {
  const char* name;
  SimulatedMissionOptions options;
};

std::vector<Case> Cases() {
  SimulatedMissionOptions survey;
  survey.legs = 6;
  survey.leg_m = 42.0;
  survey.heading_bias_deg = 1.0;
  std::vector<Case> cases{{"flat", survey}};
  const auto add = [&](const char* name, auto&& change) {
    SimulatedMissionOptions options = survey;
    change(options);
    cases.push_back({name, options});
  };
  add("dome", [](auto& o) { o.port = TestPort::kDome; });
  add("altimeter_too", [](auto& o) { o.has_altitude = true; });
  add("no_log", [](auto& o) {
    o.has_velocity = false;
    o.has_altitude = true;
  });
  add("black_10_s", [](auto& o) {
    o.blind_from_s = 100.0;
    o.blind_to_s = 110.0;
  });
  add("sand_30_s", [](auto& o) {
    o.blind_from_s = 100.0;
    o.blind_to_s = 130.0;
  });
  add("log_out_30_s", [](auto& o) {
    o.no_velocity_from_s = 100.0;
    o.no_velocity_to_s = 130.0;
  });
  add("depth_frozen", [](auto& o) {
    o.frozen_depth_from_s = 100.0;
    o.frozen_depth_to_s = 300.0;
  });
  add("clock_80_ms", [](auto& o) { o.clock_offset_s = 0.08; });
  add("revisits", [](auto& o) {  // every leg sees two thirds of the one before
    o.legs = 7;
    o.spacing_m = 1.0;
  });
  add("93_m", [](auto& o) { o.legs = 2; });
  add("video_no_log", [](auto& o) {
    o.has_velocity = false;
    o.has_altitude = true;
    o.frame_rate_hz = 10.0;
    o.keyframe_every = 5;
  });
  return cases;
}

void Run(const Case& c, int seeds) {
  double rmse = 0.0, reckoned = 0.0, nees = 0.0, end = 0.0, tracked = 0.0, length = 0.0,
         clock_ms = 0.0;
  Vec4 parts = Vec4::Zero();
  int resets = 0, outliers = 0, loops = 0;
  for (int seed = 1; seed <= seeds; ++seed) {
    SimulatedMissionOptions options = c.options;
    options.seed = static_cast<std::uint64_t>(seed);
    const SimulatedMission mission(options);
    const auto mapper = MakeMapper(mission, mission.Mapper());
    const Flight flight = Fly(mission, mapper.get(), mission.num_frames());
    length = mission.length_m();
    rmse += AlignedRmse(flight.found, flight.truth) / seeds;
    if (options.has_velocity && options.no_velocity_to_s == 0.0)
      reckoned += DeadReckonedRmse(mission, mapper->nav(), mission.num_frames()) / seeds;
    double sum = 0.0;
    for (const double value : flight.nees) sum += value;
    nees += sum / static_cast<double>(flight.nees.size()) / seeds;
    end += flight.nees.back() / seeds;
    for (const Vec4& part : flight.partial_nees)
      parts += part / static_cast<double>(flight.nees.size()) / seeds;
    loops += mapper->loops().num_closed();
    tracked += static_cast<double>(flight.num_tracking) / mission.num_frames() / seeds;
    resets += flight.reports.back().reset_counter;
    outliers += mapper->adjuster().num_nav_outliers();
    clock_ms += 1e3 * mapper->adjuster().nav_states()[kClockOffset] / seeds;
  }
  std::printf(
      "%-14s %5.0f m  rmse %.3f m (%.3f %%)  reckoned %.3f m  nees %.1f = %.1f %.1f %.1f %.1f  end "
      "%.1f  tracked %.1f %%  resets %d  loops %d  outliers %d  clock %.0f ms\n",
      c.name, length, rmse, 100.0 * rmse / length, reckoned, nees, parts[0], parts[1], parts[2],
      parts[3], end, 100.0 * tracked, resets, loops, outliers, clock_ms);
  std::fflush(stdout);
}

}  // namespace
}  // namespace rsfm

int main(int argc, char** argv) {
  const int seeds = argc > 1 ? std::atoi(argv[1]) : 3;
  for (const auto& c : rsfm::Cases()) {
    if (argc < 3 || std::string(argv[2]) == c.name) rsfm::Run(c, seeds < 1 ? 1 : seeds);
  }
  return 0;
}

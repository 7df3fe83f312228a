// Window adjustment over the map: the newest keyframes, the landmarks they see, navigation and the
// errors of its sensors move together; what leaves the window is kept as a prior on the rest.
//
// Derivatives to poses that the prior knows are taken where the prior was: directions that nothing
// measures (the place, and the yaw under a heading bias) gain no certainty from noise.
//
// A keyframe leaves with every landmark that the newest ones no longer see (and all its
// observations), its own navigation, and the displacement to the next (window_ba.h, Marginalise).
// Of landmarks that are still seen its observations are dropped: information is lost there, none is
// counted twice. Where the same landmarks come into view again much later, the old keyframes hold
// them in place, and the window's uncertainty is counted from theirs.
#pragma once

#include "rsfm/estimation/window_ba.h"
#include "rsfm/mapping/map.h"
#include "rsfm/mapping/nav_aid.h"

namespace rsfm {

class WindowAdjuster {
 public:
  // The only place that allocates.
  static Expected<WindowAdjuster> Create(const MapperOptions& options, const AnyCamera& camera);

  // The same camera in other water; allocates nothing.
  void SetCamera(const AnyCamera& camera) noexcept { camera_ = camera; }

  // Forgets the windows before: a new world begins. Its scale is known to this part of it from what
  // the windows to come will not see again; 0: their factors alone give it.
  void Reset(double sigma_scale = 0.0) noexcept;
  // The owner has moved the world, and knows its place only to these sigmas more.
  void Translate(const Vec3& by_m, const Vec3& sigma_m) noexcept;

  // The owner has moved the whole world, in a NED one about the vertical: nothing in it has become
  // more or less certain.
  void Move(const Rigid3& new_world_from_world) noexcept;

  // Adjusts the newest placed keyframes, at most window_keyframes; once there are as many, the
  // oldest leaves. `nav` is null where the world is not NED. In three parts, of which the second is
  // by far the longest and touches neither map nor navigation: it may run on another thread while
  // others read the map and insert navigation. Finish solves what nobody has solved.
  //   kNotEnoughData    "window": fewer than two keyframes
  //   what WindowBa's functions return; on any error the map is as it was
  Status Prepare(const Map& map, const NavAid* nav) noexcept;
  void Solve() noexcept;
  Expected<WindowBaReport> Finish(Map* map, NavAid* nav) noexcept;

  bool needs_solution() const { return is_prepared_ && !solution_; }

  // The keyframes that moved in the last adjustment, oldest first.
  std::span<const SlotId> window() const { return window_.span(); }
  // Whether the next adjustment needs this keyframe: the prior speaks of it.
  bool Holds(SlotId keyframe) const noexcept;
  // The first of them has left; it will not be moved again.
  bool has_left() const { return has_left_; }
  // What is known of the sensors' errors; zero where the world is not NED.
  const NavStates& nav_states() const { return states_; }
  const Mat6& nav_state_covariance() const { return state_covariance_; }
  // Measurements that disagree with the rest by more than five sigmas, of keyframes that have left.
  int num_nav_outliers() const { return num_nav_outliers_; }
  std::size_t bytes() const;

 private:
  struct Motion {  // of one keyframe's body, along and about the world's axes
    Vec3 velocity_mps = Vec3::Zero(), rate_radps = Vec3::Zero();
  };
  enum class Use : std::uint8_t { kNone, kFree, kAnchor };  // of an observation
  static constexpr int kMaxAnchors = 24;                    // old keyframes in one adjustment
  static int MaxWindow(const MapperOptions& options) { return options.window_keyframes + 4; }

  WindowAdjuster(const MapperOptions& options, const AnyCamera& camera, WindowBa ba);
  void SelectWindow(const Map& map) noexcept;
  void StartPrior(const Map& map, const NavAid* nav) noexcept;
  void MeasureMotion(const Map& map, const NavAid* nav) noexcept;
  Status AddKeyframes(const Map& map) noexcept;
  bool IsRevisited(const Map& map, const Landmark& landmark) const noexcept;
  Use UseOf(const Map& map, const Landmark& landmark, const Observation& o,
            bool is_revisited) const noexcept;
  int IndexInBa(const Map& map, const Observation& o, Use use) noexcept;
  int CountUsable(const Map& map, const Landmark& landmark) const noexcept;
  bool AddLandmark(const Map& map, SlotId id, bool must_fit) noexcept;
  void AddLandmarks(const Map& map, int min_observations) noexcept;
  void AddLeavingLandmarks(Map* map) noexcept;
  void AddGauge(int k) noexcept;
  void AddNav(const Map& map, const NavAid& nav, int k) noexcept;
  std::optional<NavFactor> Position(const Map& map, const NavAid& nav, int k) const noexcept;
  bool IsGated(const Map& map, const NavFactor& position) const noexcept;
  bool AddDisplacement(const Map& map, const NavAid& nav, int k) noexcept;
  void AddAltitude(const Map& map, const NavAid& nav, int k) noexcept;
  void AddLinks(const Map& map, const NavAid* nav) noexcept;
  void WriteBack(Map* map, bool has_nav) noexcept;
  void CountOutliers(const Map& map, const NavAid* nav) noexcept;
  void Leave(Map* map, NavAid* nav) noexcept;

  MapperOptions options_;
  AnyCamera camera_;
  WindowBa ba_;
  MarginalPrior prior_;
  FixedVector<SlotId> prior_keyframes_;  // of prior_'s poses
  FixedVector<int> prior_index_;         // the same as indices of the window
  FixedVector<SlotId> window_;
  FixedVector<Motion> motions_;      // of the window
  FixedVector<SlotId> landmarks_;    // in the order in which ba_ has them
  FixedVector<int> index_of_;        // per keyframe slot: its index in ba_, -1 where not in it
  FixedVector<int> landmark_index_;  // per landmark slot, likewise
  // Of what Prepare has put into ba_, until Finish: none before Solve.
  bool is_prepared_ = false;
  std::optional<Expected<WindowBaReport>> solution_;
  std::optional<Mat6> newest_covariance_, solved_state_covariance_;
  NavStates states_ = NavStates::Zero();
  Mat6 state_covariance_ = Mat6::Zero();
  // Of what held the window when it came back to known ground, and where that was.
  Mat6 base_covariance_ = Mat6::Zero();
  Rigid3 base_from_world_;
  SlotId anchor_;         // the newest old keyframe that holds the window now
  int num_anchored_ = 0;  // observations from such
  int num_anchors_ = 0;
  std::int32_t first_id_ = 0;  // keyframes before this one have left
  Utime positions_from_ = 0;   // earlier ones went with them
  // While these are in the window they say where the world is and, without navigation, how long.
  SlotId gauge_, gauge_second_;
  PosePrior gauge_place_, gauge_length_;
  bool has_gauge_length_ = false;
  double sigma_scale_ = 0.0;
  bool has_left_ = false, has_left_before_ = false;
  Mat3 position_covariance_ = Mat3::Zero();  // of the newest body, in the world
  int num_gated_in_row_ = 0;                 // positions
  int num_nav_outliers_ = 0;
};

}  // namespace rsfm

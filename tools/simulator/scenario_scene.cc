// The sections of a scenario file that say what is seen, and from where.
#include "tools/simulator/scenario_section.h"

namespace rsfm::simulator {
namespace {

void ReadLawnmower(Section* section, LawnmowerOptions* t) {
  Section& s = *section;
  s.Get("legs", 1, 1000, &t->legs);
  s.Get("leg_length_m", kMetres, &t->leg_length_m);
  s.Get("leg_spacing_m", kMetres, &t->leg_spacing_m);
  s.Get("altitude_m", {0.05, 100.0, "give metres, from 0.05 to 100"}, &t->altitude_m);
  s.Get("heading_deg", kDegrees, &t->heading_deg);
  s.Get("speed_mps", {1e-3, 20.0, "give metres per second, from 0.001 to 20"}, &t->speed_mps);
  bool strafes = t->turns == LawnmowerOptions::Turns::kStrafe;
  s.GetWord("turns", "rotate", "strafe", &strafes);
  t->turns = strafes ? LawnmowerOptions::Turns::kStrafe : LawnmowerOptions::Turns::kRotate;
  s.Get("turn_radius_m", kMetres, &t->turn_radius_m);
  s.Get("max_turn_rate_dps", {0.1, 360.0, "give degrees per second, from 0.1 to 360"},
        &t->max_turn_rate_dps);
  s.Get("max_acceleration_mps2", {1e-3, 100.0, "give m/s^2, from 0.001 to 100"},
        &t->max_acceleration_mps2);
  s.Get("roll_deg", kSway, &t->roll_deg);
  s.Get("pitch_deg", kSway, &t->pitch_deg);
  s.Get("yaw_deg", kSway, &t->yaw_deg);
  s.Get("sway_m", kLength, &t->sway_m);
  s.Get("heave_m", kLength, &t->heave_m);
  s.Get("sway_period_s", kSeconds, &t->sway_period_s);
}

void ReadSeafloor(YamlMap* root, SeafloorOptions* f) {
  Section s(root, "seafloor");
  s.Get("depth_m", kDepth, &f->depth_m);
  s.Get("relief_m", kLength, &f->relief_m);
  s.Get("relief_length_m", kMetres, &f->relief_length_m);
  s.Get("ripple_height_m", kLength, &f->ripple_height_m);
  s.Get("ripple_length_m", kMetres, &f->ripple_length_m);
  s.Get("stones_per_m2", {0.0, 1000.0, "give stones per square metre, from 0 to 1000"},
        &f->stones_per_m2);
  s.Get("stone_min_radius_m", kMetres, &f->stone_min_radius_m);
  s.Get("stone_max_radius_m", kMetres, &f->stone_max_radius_m);
  s.Get("poor_fraction", kShare, &f->poor_fraction);
  s.Get("repeat_fraction", kShare, &f->repeat_fraction);
  s.Get("repeat_length_m", kMetres, &f->repeat_length_m);
  s.Get("cell_m", kMetres, &f->cell_m);
  if (s.is_there() && f->stone_max_radius_m < f->stone_min_radius_m) {
    s.map().AddProblem("stone_max_radius_m", "is less than stone_min_radius_m", "make it larger");
  }
}

void ReadTank(YamlMap* root, TankOptions* t) {
  Section s(root, "tank");
  constexpr Bounds kSide{0.2, 20.0, "give metres, from 0.2 to 20"};
  s.Get("length_m", kSide, &t->length_m);
  s.Get("width_m", kSide, &t->width_m);
  s.Get("height_m", kSide, &t->height_m);
  s.Get("depth_m", kDepth, &t->depth_m);
  s.Get("relief_m", {0.0, 0.2, "give metres, from 0 to 0.2"}, &t->relief_m);
  s.Get("stones", 0, 500, &t->stones);
  s.Get("bricks", 0, 500, &t->bricks);
  s.Get("posts", 0, 500, &t->posts);
  s.Get("texel_m", {1e-4, 0.1, "give metres, from 0.0001 to 0.1"}, &t->texel_m);
  s.Get("contrast", kShare, &t->contrast);
  if (!s.is_there()) return;
  const double surface_m2 =
      t->length_m * t->width_m + 2.0 * (t->length_m + t->width_m) * t->height_m;
  if (surface_m2 / (t->texel_m * t->texel_m) > kMaxTankTexels) {
    s.map().AddProblem("texel_m", "makes more texture than 250 million texels",
                       "make it larger, or the tank smaller");
  }
}

void ReadOrbit(Section* section, OrbitOptions* o) {
  Section& s = *section;
  constexpr Bounds kHeight{0.05, 1000.0, "give metres above the floor, from 0.05 to 1000"};
  s.Get("images", 1, 1'000'000, &o->images);
  s.Get("rings", {0.01, 1000.0, "give a number of rings, from 0.01 to 1000"}, &o->rings);
  s.GetVec2("center_ne_m", -1e5, 1e5, "give metres, north and east", &o->center_ne_m);
  s.Get("radius_north_m", kMetres, &o->radius_north_m);
  s.Get("radius_east_m", kMetres, &o->radius_east_m);
  s.Get("last_ring_scale", {0.05, 20.0, "give a factor from 0.05 to 20"}, &o->last_ring_scale);
  s.Get("top_height_m", kHeight, &o->top_height_m);
  s.Get("bottom_height_m", kHeight, &o->bottom_height_m);
  s.Get("bob_m", kLength, &o->bob_m);
  s.Get("look_across", {-0.9, 10.0, "give a share from -0.9 to 10"}, &o->look_across);
  s.Get("target_height_m", {-100.0, 1000.0, "give metres above the floor"}, &o->target_height_m);
  s.Get("target_wander_m", kLength, &o->target_wander_m);
  s.Get("roll_deg", kSway, &o->roll_deg);
}

void ReadMesh(YamlMap* root, const std::filesystem::path& folder, MeshOptions* m) {
  Section s(root, "mesh");
  if (!s.is_there()) return;
  s.GetFile("file", folder, &m->file);
  s.GetFile("texture", folder, &m->texture);
  s.GetWord("up", "-z", "+z", &m->z_is_up);
  s.Get("sky_light", kShare, &m->sky_light);
  if (m->file.empty()) s.map().AddProblem("file", "is missing", "name a PLY file");
}

void ReadDem(YamlMap* root, const std::filesystem::path& folder, std::filesystem::path* dem) {
  Section s(root, "dem");
  if (!s.is_there()) return;
  s.GetFile("file", folder, dem);
  if (dem->empty()) s.map().AddProblem("file", "is missing", "name an Esri ASCII grid");
}

void ReadRecorded(Section* section, const std::filesystem::path& folder, RecordedOptions* r) {
  Section& s = *section;
  constexpr Bounds kTime{0.0, 1e7, "give seconds, 0 or more"};
  s.GetFile("file", folder, &r->file);
  s.GetWord("poses", "camera", "body", &r->poses_are_body);
  s.Get("start_s", kTime, &r->start_s);
  s.Get("duration_s", kTime, &r->duration_s);
  s.Get("smooth_s", {0.0, 1e4, "give seconds, from 0 to 10000"}, &r->smooth_s);
  s.Get("center", &r->center);
  s.Get("altitude_m", {0.0, 1000.0, "give metres, from 0 to 1000; 0 is as recorded"},
        &r->altitude_m);
  if (r->file.empty()) {
    s.map().AddProblem("file", "is missing", "name a TUM file or a NAV.csv");
  }
}

// World depth of the generated floor that the file asks for.
double FloorDepth(const Scenario& scenario) {
  return scenario.scene == SceneKind::kTank ? scenario.tank.depth_m : scenario.seafloor.depth_m;
}

}  // namespace

void ReadScene(YamlMap* root, const std::filesystem::path& folder, Scenario* scenario) {
  if (root->Has("tank")) scenario->scene = SceneKind::kTank;
  if (root->Has("mesh")) scenario->scene = SceneKind::kMesh;
  const bool has_floor = root->Has("seafloor") || root->Has("dem");
  const int scenes =
      (root->Has("tank") ? 1 : 0) + (root->Has("mesh") ? 1 : 0) + (has_floor ? 1 : 0);
  if (scenes > 1) {
    root->AddProblem(root->Has("tank") ? "tank" : "mesh", "is one scene of several",
                     "keep one of tank, mesh, and seafloor with or without dem");
  }
  ReadSeafloor(root, &scenario->seafloor);
  ReadTank(root, &scenario->tank);
  ReadMesh(root, folder, &scenario->mesh);
  ReadDem(root, folder, &scenario->dem);
}

void ReadTrajectory(YamlMap* root, const std::filesystem::path& folder, Scenario* scenario) {
  Section s(root, "trajectory");
  int kind = scenario->scene == SceneKind::kTank ? 1 : 0;
  s.GetChoice("type", {"lawnmower", "orbit", "recorded"}, &kind);
  scenario->path = static_cast<PathKind>(kind);
  if (scenario->path == PathKind::kOrbit) {
    ReadOrbit(&s, &scenario->orbit);
    return;
  }
  if (scenario->path == PathKind::kRecorded) {
    ReadRecorded(&s, folder, &scenario->recorded);
    return;
  }
  ReadLawnmower(&s, &scenario->trajectory);
  if (scenario->scene != SceneKind::kMesh &&
      scenario->trajectory.altitude_m >= FloorDepth(*scenario)) {
    s.map().AddProblem("altitude_m", "would lift the vehicle out of the water",
                       "make it less than the scene's depth_m");
  }
}

}  // namespace rsfm::simulator

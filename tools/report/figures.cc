#include "tools/report/figures.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numeric>

namespace rsfm {
namespace {

constexpr std::size_t kMaxDots = 20000;  // of the map: more make an SVG slow to show

std::string Text(const char* format, double value) {
  char text[64];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

// Value below which the given share of the values lies. Precondition: not empty.
double Quantile(std::vector<double> values, double share) {
  const auto rank = static_cast<std::size_t>(share * static_cast<double>(values.size() - 1));
  const auto nth = values.begin() + static_cast<std::ptrdiff_t>(rank);
  std::nth_element(values.begin(), nth, values.end());
  return *nth;
}

// What of a place is drawn to the right, upwards and as depth: east, north, down; or, where the
// world has no such directions, the path's principal axes.
struct View {
  Mat3 axes = Mat3::Identity();  // rows: right, up, depth
  Vec3 origin = Vec3::Zero();
  const char* right = "east [m]";
  const char* up = "north [m]";
  const char* depth = "depth [m]";

  Vec3 operator()(const Vec3& place) const { return axes * (place - origin); }
};

View MakeView(const ReportData& data) {
  View view;
  if (data.is_ned) {
    view.axes << 0, 1, 0, 1, 0, 0, 0, 0, 1;
    return view;
  }
  const auto& poses = data.truth.empty() ? data.tracks.front().poses : data.truth;
  for (const TrajectoryPose& pose : poses) view.origin += pose.world_from_camera.translation;
  view.origin /= static_cast<double>(poses.size());
  Mat3 scatter = Mat3::Zero();
  Vec3 forward = Vec3::Zero();
  for (const TrajectoryPose& pose : poses) {
    const Vec3 d = pose.world_from_camera.translation - view.origin;
    scatter += d * d.transpose();
    forward += pose.world_from_camera.rotation * Vec3::UnitZ();
  }
  const Eigen::SelfAdjointEigenSolver<Mat3> solver(scatter);
  Vec3 depth = solver.eigenvectors().col(0);  // across the plane of the path
  if (depth.dot(forward) < 0.0) depth = -depth;
  const Vec3 right = solver.eigenvectors().col(2);
  view.axes.row(0) = right.transpose();
  view.axes.row(2) = depth.transpose();
  view.axes.row(1) = right.cross(depth).transpose();
  view.right = "along the path's longest axis [m]";
  view.up = "across [m]";
  view.depth = "towards the scene [m]";
  return view;
}

Colour TrackColour(const ReportTrack& track) { return track.name == "on-board" ? kOrange : kBlue; }

struct Xyz {
  std::vector<double> x, y, z, t;
};

Xyz Places(const std::vector<TrajectoryPose>& poses, const View& view) {
  Xyz result;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const Vec3 p = view(poses[i].world_from_camera.translation);
    result.x.push_back(p.x());
    result.y.push_back(p.y());
    result.z.push_back(p.z());
    result.t.push_back(static_cast<double>(poses[i].utime));
  }
  return result;
}

Figure TrajectoryFigure(const ReportData& data, const View& view) {
  PlotOptions options;
  options.title = "Trajectory from above";
  options.x_label = view.right;
  options.y_label = view.up;
  options.equal_aspect = true;
  options.scale_bar = true;
  options.height = 620.0;
  Plot plot(options);
  if (!data.truth.empty()) {
    const Xyz truth = Places(data.truth, view);
    plot.AddLine("ground truth", truth.x, truth.y, {kInk, 4.0});
  }
  for (const ReportTrack& track : data.tracks) {
    const Xyz xyz = Places(track.poses, view);
    plot.AddLine(track.name, xyz.x, xyz.y, {TrackColour(track), 1.8});
    plot.AddDots("", xyz.x, xyz.y, {TrackColour(track)}, 2.6);
  }
  return {"trajectory", "Camera positions from above.", std::move(plot)};
}

Figure DepthFigure(const ReportData& data, const View& view) {
  PlotOptions options;
  options.title = "Trajectory from the side";
  options.y_label = view.depth;
  options.y_down = true;
  options.height = 320.0;
  double start = std::numeric_limits<double>::infinity();
  bool has_times = true;
  const auto look = [&](const std::vector<TrajectoryPose>& poses) {
    for (const TrajectoryPose& pose : poses) {
      start = std::min(start, static_cast<double>(pose.utime));
      has_times &= pose.utime != 0;
    }
  };
  look(data.truth);
  for (const ReportTrack& track : data.tracks) look(track.poses);
  options.x_label = has_times ? "time [s]" : "image";
  Plot plot(options);
  const auto add = [&](const std::string& name, const std::vector<TrajectoryPose>& poses,
                       const Stroke& stroke) {
    Xyz xyz = Places(poses, view);
    for (std::size_t i = 0; i < xyz.t.size(); ++i) {
      xyz.t[i] = has_times ? 1e-6 * (xyz.t[i] - start) : static_cast<double>(i);
    }
    plot.AddLine(name, xyz.t, xyz.z, stroke);
  };
  if (!data.truth.empty()) add("ground truth", data.truth, {kInk, 4.0});
  for (const ReportTrack& track : data.tracks) {
    add(track.name, track.poses, {TrackColour(track), 1.8});
  }
  return {"depth", "Depth of the camera over the mission.", std::move(plot)};
}

// An even choice of the points, deepest first, so that what stands up is drawn on top.
std::vector<std::size_t> ChoosePoints(const std::vector<Vec3>& in_view) {
  std::vector<std::size_t> chosen;
  const std::size_t step = (in_view.size() + kMaxDots - 1) / kMaxDots;
  for (std::size_t i = 0; i < in_view.size(); i += std::max<std::size_t>(step, 1)) {
    chosen.push_back(i);
  }
  std::stable_sort(chosen.begin(), chosen.end(),
                   [&](std::size_t a, std::size_t b) { return in_view[a].z() > in_view[b].z(); });
  return chosen;
}

Figure MapFigure(const ReportData& data, const View& view, bool by_depth) {
  std::vector<Vec3> in_view;
  std::vector<double> xs, ys, zs;
  for (const Vec3& point : data.points) {
    in_view.push_back(view(point));
    xs.push_back(in_view.back().x());
    ys.push_back(in_view.back().y());
    zs.push_back(in_view.back().z());
  }
  // Stray points would shrink the map: a margin about the middle 98 % is shown.
  const auto limits = [](const std::vector<double>& values) {
    const double low = Quantile(values, 0.01);
    const double high = Quantile(values, 0.99);
    return std::pair(low - 0.15 * (high - low), high + 0.15 * (high - low));
  };
  const auto [x_low, x_high] = limits(xs);
  const auto [y_low, y_high] = limits(ys);
  const double shallow = Quantile(zs, 0.02);
  const double deep = std::max(Quantile(zs, 0.98), shallow + 1e-6);
  PlotOptions options;
  options.title = by_depth ? "Map, coloured by depth" : "Map, in the images' colours";
  options.x_label = view.right;
  options.y_label = view.up;
  options.equal_aspect = true;
  options.scale_bar = true;
  options.height = 620.0;
  Plot plot(options);
  std::vector<double> x, y;
  std::vector<Colour> colours;
  for (const std::size_t i : ChoosePoints(in_view)) {
    const Vec3& p = in_view[i];
    if (p.x() < x_low || p.x() > x_high || p.y() < y_low || p.y() > y_high) continue;
    x.push_back(p.x());
    y.push_back(p.y());
    const auto& rgb = data.colours[i];
    // Steps of a 32nd keep the number of different colours, and so of SVG paths, small.
    const double fraction = std::round(32.0 * (deep - p.z()) / (deep - shallow)) / 32.0;
    const auto coarse = [](std::uint8_t v) { return static_cast<std::uint8_t>((v & 0xF0) | 8); };
    colours.push_back(by_depth ? Viridis(fraction)
                               : Colour{coarse(rgb[0]), coarse(rgb[1]), coarse(rgb[2])});
  }
  plot.AddDots("", std::move(x), std::move(y), std::move(colours), 1.1);
  for (const ReportTrack& track : data.tracks) {
    if (&track != &data.tracks.back()) continue;
    const Xyz xyz = Places(track.poses, view);
    plot.AddLine(track.name + " trajectory", xyz.x, xyz.y, {kRed, 1.3});
  }
  if (by_depth) plot.SetColourBar(view.depth, deep, shallow);
  const std::string count = std::to_string(data.points.size());
  return {by_depth ? "map_depth" : "map_colour", "The " + count + " points of the map from above.",
          std::move(plot)};
}

Figure ErrorFigure(const ReportData& data, bool of_rotation) {
  PlotOptions options;
  options.title = of_rotation ? "Rotation error of each image" : "Position error of each image";
  options.x_label = "image";
  options.y_label = of_rotation ? "error [\u00b0]" : "error [mm]";
  options.y_from_zero = true;
  options.height = 320.0;
  Plot plot(options);
  for (const ReportTrack& track : data.tracks) {
    const auto& errors = of_rotation ? track.rotation_error_deg : track.position_error_mm;
    if (errors.empty()) continue;
    const double mean =
        std::accumulate(errors.begin(), errors.end(), 0.0) / static_cast<double>(errors.size());
    const std::string unit = of_rotation ? "\u00b0" : " mm";
    plot.AddLine(track.name + ", mean " + Text("%.3g", mean) + unit, track.image_number, errors,
                 {TrackColour(track), 1.8});
    plot.AddDots("", track.image_number, errors, {TrackColour(track)}, 2.4);
  }
  return {of_rotation ? "rotation_error" : "position_error",
          "Distance from the ground truth, image by image.", std::move(plot)};
}

Figure ImageResidualFigure(const ReportData& data) {
  PlotOptions options;
  options.title = "Reprojection error of each image";
  options.x_label = "image";
  options.y_label = "median error [px]";
  options.y_from_zero = true;
  options.height = 320.0;
  Plot plot(options);
  std::vector<double> number(data.image_residual_px.size());
  std::iota(number.begin(), number.end(), 0.0);
  plot.AddLine("", number, data.image_residual_px, {kBlue, 1.8});
  plot.AddDots("", number, data.image_residual_px, {kBlue}, 2.4);
  return {"image_residuals", "Median distance between features and projected points.",
          std::move(plot)};
}

Figure HistogramFigure(const ReportData& data) {
  constexpr int kBins = 48;
  const double mean = std::accumulate(data.residuals_px.begin(), data.residuals_px.end(), 0.0) /
                      static_cast<double>(data.residuals_px.size());
  const double median = Quantile(data.residuals_px, 0.5);
  const double limit = std::max(1.15 * Quantile(data.residuals_px, 0.99), 1e-6);
  std::vector<double> edges, counts(kBins, 0.0);
  for (int i = 0; i <= kBins; ++i) edges.push_back(limit * i / kBins);
  for (const double value : data.residuals_px) {
    const auto bin = static_cast<std::size_t>(value / limit * kBins);
    if (bin < counts.size()) counts[bin] += 1.0;
  }
  PlotOptions options;
  options.title = "Reprojection error of each observation";
  options.x_label = "error [px]";
  options.y_label = "observations";
  options.y_from_zero = true;
  options.height = 340.0;
  Plot plot(options);
  plot.AddBars(std::to_string(data.residuals_px.size()) + " observations", edges, counts, kGreen);
  plot.AddLevel("mean " + Text("%.3f", mean) + " px", mean, true, {kInk, 1.5});
  plot.AddLevel("median " + Text("%.3f", median) + " px", median, true, {kRed, 1.5, true});
  return {"residuals", "Distance between features and projected points, in the image.",
          std::move(plot)};
}

}  // namespace

std::vector<Figure> MakeFigures(const ReportData& data) {
  const View view = MakeView(data);
  std::vector<Figure> figures;
  figures.push_back(TrajectoryFigure(data, view));
  figures.push_back(DepthFigure(data, view));
  if (!data.points.empty()) figures.push_back(MapFigure(data, view, true));
  if (!data.points.empty() && data.has_colours) figures.push_back(MapFigure(data, view, false));
  const auto any = [&](auto member) {
    return std::any_of(data.tracks.begin(), data.tracks.end(),
                       [&](const ReportTrack& track) { return !(track.*member).empty(); });
  };
  if (any(&ReportTrack::position_error_mm)) figures.push_back(ErrorFigure(data, false));
  if (any(&ReportTrack::rotation_error_deg)) figures.push_back(ErrorFigure(data, true));
  if (!data.residuals_px.empty()) {
    figures.push_back(ImageResidualFigure(data));
    figures.push_back(HistogramFigure(data));
  }
  return figures;
}

}  // namespace rsfm

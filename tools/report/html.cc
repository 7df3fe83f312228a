#include "tools/report/html.h"

#include <algorithm>
#include <cstdio>
#include <numeric>

namespace rsfm {
namespace {

constexpr const char* kStyle = R"(
body { font: 15px/1.45 Helvetica, Arial, sans-serif; color: #222; max-width: 62em; margin: 2em auto; padding: 0 1em; }
h1 { font-size: 1.5em; margin-bottom: 0.1em; } h2 { font-size: 1.15em; margin-top: 2em; }
table { border-collapse: collapse; margin: 0.6em 0; } th { font-weight: 600; text-align: left; }
td, th { padding: 0.2em 0.9em 0.2em 0; border-bottom: 1px solid #ddd; vertical-align: top; }
td.number { text-align: right; font-variant-numeric: tabular-nums; }
figure { margin: 1.2em 0; } figcaption { color: #555; font-size: 0.9em; }
svg { max-width: 100%; height: auto; } .source { color: #555; }
)";

std::string Escape(const std::string& text) {
  std::string result;
  for (const char c : text) {
    if (c == '&') {
      result += "&amp;";
    } else if (c == '<') {
      result += "&lt;";
    } else if (c == '>') {
      result += "&gt;";
    } else if (c == '"') {
      result += "&quot;";
    } else {
      result += c;
    }
  }
  return result;
}

std::string Number(double value) {
  char text[48];
  std::snprintf(text, sizeof text, "%.6g", value);
  return text;
}

class Table {
 public:
  void Row(const std::string& name, const std::string& value) {
    rows_ += "<tr><th>" + Escape(name) + "</th><td>" + Escape(value) + "</td></tr>\n";
  }
  std::string Finish() const { return rows_.empty() ? "" : "<table>\n" + rows_ + "</table>\n"; }

 private:
  std::string rows_;
};

double PathLength(const std::vector<TrajectoryPose>& poses) {
  double length = 0.0;
  for (std::size_t i = 1; i < poses.size(); ++i) {
    length += (poses[i].world_from_camera.translation - poses[i - 1].world_from_camera.translation)
                  .norm();
  }
  return length;
}

std::string Summary(const ReportData& data) {
  Table table;
  if (data.num_images > 0) table.Row("Images in the model", std::to_string(data.num_images));
  if (!data.points.empty()) table.Row("Points", std::to_string(data.points.size()));
  if (data.num_observations > 0) table.Row("Observations", std::to_string(data.num_observations));
  if (!data.residuals_px.empty()) {
    const double sum = std::accumulate(data.residuals_px.begin(), data.residuals_px.end(), 0.0);
    table.Row("Mean reprojection error",
              Number(sum / static_cast<double>(data.residuals_px.size())) + " px");
  }
  for (const ReportTrack& track : data.tracks) {
    table.Row("Path, " + track.name, std::to_string(track.poses.size()) + " poses, " +
                                         Number(PathLength(track.poses)) + " m");
  }
  if (!data.truth.empty()) {
    table.Row("Path, ground truth", std::to_string(data.truth.size()) + " poses, " +
                                        Number(PathLength(data.truth)) + " m");
  }
  return "<h2>Summary</h2>\n" + table.Finish();
}

std::string Accuracy(const ReportData& data) {
  std::string rows;
  for (const ReportTrack& track : data.tracks) {
    if (!track.evaluation) continue;
    const Evaluation& e = *track.evaluation;
    const auto cell = [](const std::optional<double>& value) {
      return "<td class=\"number\">" + (value ? Number(*value) : std::string("\u2013")) + "</td>";
    };
    rows += "<tr><th>" + Escape(track.name) + "</th><td class=\"number\">" +
            std::to_string(e.num_images) + "</td>" + cell(e.position_error_mm) +
            cell(e.position_rmse_mm) + cell(e.position_max_mm) + cell(e.rotation_error_deg) +
            cell(e.point_error_mm) + cell(e.truth_from_estimate.scale) + "</tr>\n";
  }
  if (rows.empty()) return "";
  return "<h2>Accuracy against the ground truth</h2>\n<table>\n"
         "<tr><th></th><th>images</th><th>position, mean [mm]</th><th>root mean square [mm]</th>"
         "<th>largest [mm]</th><th>rotation, mean [\u00b0]</th><th>points to mesh, mean [mm]</th>"
         "<th>scale to the truth</th></tr>\n" +
         rows + "</table>\n<p>Alignment: " + Describe(data.alignment) + ".</p>\n";
}

std::string CameraAndPort(const ReportData& data) {
  const CameraConfig& camera = data.rig.camera;
  Table table;
  std::string params;
  for (const double value : camera.lens_params) {
    params += (params.empty() ? "" : ", ") + Number(value);
  }
  table.Row("Lens", std::string(ToString(camera.lens)) + ", " + std::to_string(camera.width) +
                        " \u00d7 " + std::to_string(camera.height) + " px");
  table.Row(std::string(LensParamNames(camera.lens)), params);
  const PortConfig& port = camera.port;
  table.Row("Port", std::string(ToString(port.type)));
  const auto vector = [](const Vec3& v) {
    return Number(v.x()) + ", " + Number(v.y()) + ", " + Number(v.z());
  };
  if (port.type == PortType::kFlat) {
    table.Row("Normal", vector(port.normal));
    table.Row("Distance", Number(1e3 * port.distance_m) + " mm");
  } else if (port.type == PortType::kDome) {
    table.Row("Centre", vector(1e3 * port.center_m) + " mm");
    table.Row("Inner radius", Number(1e3 * port.radius_m) + " mm");
  }
  if (port.type != PortType::kNone) {
    table.Row("Thickness", Number(1e3 * port.thickness_m) + " mm");
    table.Row(
        "Indices (air, glass, water)",
        Number(port.index_air) + ", " + Number(port.index_glass) + ", " + Number(port.index_water));
  }
  return "<h2>Camera and port</h2>\n" + table.Finish();
}

std::string ScalarText(const nlohmann::ordered_json& value) {
  if (value.is_string()) return value.get<std::string>();
  if (value.is_boolean()) return value.get<bool>() ? "yes" : "no";
  if (value.is_number_float()) return Number(value.get<double>());
  if (value.is_null()) return "\u2013";
  if (value.is_array() && value.empty()) return "none";
  return value.dump();
}

// "standard_deviation" for people.
std::string Words(std::string key) {
  for (char& c : key) c = c == '_' ? ' ' : c;
  return key;
}

template <typename Predicate>
bool IsListOf(const nlohmann::ordered_json& value, Predicate is_one) {
  return value.is_array() && !value.empty() && std::all_of(value.begin(), value.end(), is_one);
}

// Sentences, warnings for instance.
std::string TextList(const nlohmann::ordered_json& texts) {
  std::string html = "<ul>\n";
  for (const auto& text : texts) html += "<li>" + Escape(text.get<std::string>()) + "</li>\n";
  return html + "</ul>\n";
}

// Records as a table with a column per key of the first.
std::string RecordTable(const nlohmann::ordered_json& records) {
  std::string html = "<table>\n<tr>";
  for (const auto& [key, ignored] : records.front().items()) {
    html += "<th>" + Escape(Words(key)) + "</th>";
  }
  html += "</tr>\n";
  for (const auto& record : records) {
    html += "<tr>";
    for (const auto& [key, ignored] : records.front().items()) {
      const bool has = record.contains(key);
      const bool is_number = has && record[key].is_number();
      html += is_number ? "<td class=\"number\">" : "<td>";
      html += (has ? Escape(ScalarText(record[key])) : "") + "</td>";
    }
    html += "</tr>\n";
  }
  return html + "</table>\n";
}

// Whatever refine wrote down: scalars as rows, records as tables, sentences as lists, objects as
// sections.
std::string JsonHtml(const nlohmann::ordered_json& object, int level) {
  Table scalars;
  std::string rest;
  const std::string tag = "h" + std::to_string(std::min(level, 6));
  for (const auto& [key, value] : object.items()) {
    const std::string heading = "<" + tag + ">" + Escape(Words(key)) + "</" + tag + ">\n";
    if (value.is_object()) {
      rest += heading + JsonHtml(value, level + 1);
    } else if (IsListOf(value, [](const auto& e) { return e.is_object(); })) {
      rest += heading + RecordTable(value);
    } else if (IsListOf(value, [](const auto& e) { return e.is_string(); })) {
      rest += heading + TextList(value);
    } else if (!value.is_array() || value.size() <= 16) {
      scalars.Row(Words(key), ScalarText(value));
    }
  }
  return scalars.Finish() + rest;
}

}  // namespace

std::string FormatHtml(const ReportData& data, const std::vector<Figure>& figures) {
  std::string html =
      "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<title>" +
      Escape(data.title) + "</title>\n<style>" + kStyle + "</style>\n</head>\n<body>\n";
  html += "<h1>" + Escape(data.title) + "</h1>\n<p class=\"source\">" +
          (data.is_mission ? "Mission " : "Model ") + Escape(data.source) + "</p>\n";
  html += Summary(data) + Accuracy(data) + CameraAndPort(data);
  if (data.refinement.is_object()) html += "<h2>Refinement</h2>\n" + JsonHtml(data.refinement, 3);
  html += "<h2>Figures</h2>\n";
  for (const Figure& figure : figures) {
    html += "<figure>\n" + figure.plot.Svg() + "<figcaption>" + Escape(figure.caption) +
            "</figcaption>\n</figure>\n";
  }
  return html + "</body>\n</html>\n";
}

}  // namespace rsfm

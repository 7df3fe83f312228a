#include "rsfm/io/yaml_map.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <utility>

#include "rsfm/io/text.h"

namespace rsfm {
namespace {

int LineOfNode(const YAML::Node& node) { return node.Mark().line + 1; }

std::string Describe(const YAML::Node& node) {
  if (node.IsMap()) return "a mapping";
  if (node.IsSequence()) return "a list";
  if (node.IsNull()) return "empty";
  return Quoted(node.Scalar());
}

// YAML's own spellings of what is not finite, beside those that from_chars takes.
std::optional<double> NumberOf(const YAML::Node& node) {
  if (!node.IsScalar()) return std::nullopt;
  std::string text = node.Scalar();
  if (text.find(".nan") != std::string::npos || text.find(".NaN") != std::string::npos ||
      text.find(".NAN") != std::string::npos) {
    return std::numeric_limits<double>::quiet_NaN();
  }
  if (text.find(".inf") != std::string::npos || text.find(".Inf") != std::string::npos ||
      text.find(".INF") != std::string::npos) {
    return std::numeric_limits<double>::infinity();
  }
  return ParseNumber(text);
}

}  // namespace

YamlMap::YamlMap(const YAML::Node& node, std::string path, std::string file,
                 std::vector<Diagnostic>* problems)
    : node_(node), path_(std::move(path)), file_(std::move(file)), problems_(problems) {
  if (!node_.IsMap()) {
    problems_->push_back({Errc::kInvalidArgument, file_, path_,
                          "is " + Describe(node_) + ", not a mapping", "write it as 'key: value'",
                          LineOfNode(node_)});
    node_ = YAML::Node(YAML::NodeType::Map);
  }
}

std::string YamlMap::PathOf(std::string_view key) const {
  if (path_.empty() || key.empty()) return path_ + std::string(key);
  return path_ + "." + std::string(key);
}

int YamlMap::LineOf(std::string_view key) const {
  if (!key.empty()) {
    const YAML::Node value = std::as_const(node_)[std::string(key)];
    if (value) return LineOfNode(value);
  }
  return LineOfNode(node_);
}

void YamlMap::AddProblem(std::string_view key, std::string problem, std::string fix, Errc code) {
  problems_->push_back({code, file_, PathOf(key), std::move(problem), std::move(fix), LineOf(key)});
}

YAML::Node YamlMap::Find(std::string_view key, Need need) {
  known_.emplace_back(key);
  YAML::Node value = std::as_const(node_)[std::string(key)];
  if (!value && need == Need::kRequired) {
    AddProblem(key, "is missing", "add '" + std::string(key) + ": ...'");
  }
  return value;
}

bool YamlMap::GetNumber(std::string_view key, Need need, const Bounds& bounds, double* value) {
  const YAML::Node node = Find(key, need);
  if (!node) return false;
  const std::optional<double> number = NumberOf(node);
  if (!number) {
    AddProblem(key, "is " + Describe(node) + ", not a number", bounds.fix);
    return false;
  }
  if (!std::isfinite(*number)) {
    AddProblem(key, "is not finite: " + Describe(node), bounds.fix);
    return false;
  }
  if (*number < bounds.low || *number > bounds.high) {
    AddProblem(key, "is out of range: " + FormatNumber(*number), bounds.fix);
    return false;
  }
  *value = *number;
  return true;
}

bool YamlMap::GetInteger(std::string_view key, Need need, std::int64_t low, std::int64_t high,
                         std::int64_t* value) {
  const YAML::Node node = Find(key, need);
  if (!node) return false;
  const std::string fix =
      "give a whole number from " + std::to_string(low) + " to " + std::to_string(high);
  const std::optional<std::int64_t> number =
      node.IsScalar() ? ParseInteger(node.Scalar()) : std::nullopt;
  if (!number) {
    AddProblem(key, "is " + Describe(node) + ", not a whole number", fix);
    return false;
  }
  if (*number < low || *number > high) {
    AddProblem(key, "is out of range: " + std::to_string(*number), fix);
    return false;
  }
  *value = *number;
  return true;
}

bool YamlMap::GetBool(std::string_view key, Need need, bool* value) {
  const YAML::Node node = Find(key, need);
  if (!node) return false;
  const std::string text = node.IsScalar() ? node.Scalar() : std::string();
  if (text != "true" && text != "false") {
    AddProblem(key, "is " + Describe(node) + ", not a yes or no", "write true or false");
    return false;
  }
  *value = text == "true";
  return true;
}

bool YamlMap::GetText(std::string_view key, Need need, std::string* value) {
  const YAML::Node node = Find(key, need);
  if (!node) return false;
  if (!node.IsScalar() || node.Scalar().empty()) {
    AddProblem(key, "is " + Describe(node) + ", not a word", "give a text");
    return false;
  }
  *value = node.Scalar();
  return true;
}

bool YamlMap::GetNumbers(std::string_view key, Need need, std::vector<double>* values) {
  const YAML::Node node = Find(key, need);
  if (!node) return false;
  const char* fix = "write a list of numbers, '[1, 2, 3]'";
  if (!node.IsSequence()) {
    AddProblem(key, "is " + Describe(node) + ", not a list", fix);
    return false;
  }
  std::vector<double> result;
  for (const YAML::Node& element : node) {
    const std::string which = "its element " + std::to_string(result.size() + 1);
    const std::optional<double> number = NumberOf(element);
    if (!number) {
      AddProblem(key, which + " is " + Describe(element) + ", not a number", fix);
      return false;
    }
    if (!std::isfinite(*number)) {
      AddProblem(key, which + " is not finite: " + Describe(element), "give a finite number");
      return false;
    }
    result.push_back(*number);
  }
  *values = std::move(result);
  return true;
}

bool YamlMap::GetVec3(std::string_view key, Need need, Vec3* value) {
  std::vector<double> numbers;
  if (!GetNumbers(key, need, &numbers)) return false;
  if (numbers.size() != 3) {
    AddProblem(key, "has " + std::to_string(numbers.size()) + " elements", "give three: [x, y, z]");
    return false;
  }
  *value = Vec3(numbers[0], numbers[1], numbers[2]);
  return true;
}

YAML::Node YamlMap::GetMap(std::string_view key, Need need) {
  const YAML::Node node = Find(key, need);
  if (!node || node.IsMap()) return node;
  AddProblem(key, "is " + Describe(node) + ", not a mapping",
             "write its fields below it, indented");
  return YAML::Node(YAML::NodeType::Undefined);
}

YAML::Node YamlMap::GetList(std::string_view key, Need need) {
  const YAML::Node node = Find(key, need);
  if (!node || node.IsSequence()) return node;
  AddProblem(key, "is " + Describe(node) + ", not a list", "write one '- ' line per element");
  return YAML::Node(YAML::NodeType::Undefined);
}

void YamlMap::Finish() {
  std::set<std::string> seen;
  for (const auto& entry : node_) {
    const std::string key = entry.first.IsScalar() ? entry.first.Scalar() : std::string("?");
    const int line = LineOfNode(entry.first);
    if (!seen.insert(key).second) {
      problems_->push_back(
          {Errc::kInvalidArgument, file_, PathOf(key), "is given twice", "keep one of them", line});
    }
    if (std::find(known_.begin(), known_.end(), key) != known_.end()) continue;
    const std::string_view nearest = NearestWord(key, {known_.begin(), known_.end()});
    std::string fix;
    if (!nearest.empty()) {
      fix = "did you mean '" + std::string(nearest) + "'?";
    } else {
      fix = "remove it; known here: ";
      for (std::size_t i = 0; i < known_.size(); ++i) fix += (i > 0 ? ", " : "") + known_[i];
    }
    problems_->push_back(
        {Errc::kInvalidArgument, file_, PathOf(key), "is not a known field", fix, line});
  }
}

IoExpected<YAML::Node> ParseYaml(const std::string& text, const std::string& file) {
  try {
    return YAML::Load(text);
  } catch (const YAML::Exception& error) {
    return Fail({Errc::kCorrupt, file, "", "is not YAML: " + error.msg, "repair the line",
                 error.mark.line + 1});
  }
}

}  // namespace rsfm

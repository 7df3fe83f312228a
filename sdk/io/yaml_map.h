// One mapping of a YAML file, read strictly: what is missing, mistyped, out of range, repeated or
// unknown becomes a Diagnostic that names file, line, field and fix. For sdk/io's own readers.
#pragma once

#include <yaml-cpp/yaml.h>

#include <cstdint>
#include <limits>
#include <string>
#include <string_view>
#include <vector>

#include "rsfm/base/linear.h"
#include "rsfm/io/diagnostic.h"

namespace rsfm {

enum class Need : std::uint8_t { kRequired, kOptional };

// What a number may be; `fix` says so in words.
struct Bounds {
  double low = -std::numeric_limits<double>::max();
  double high = std::numeric_limits<double>::max();
  const char* fix = "give a number";
};

class YamlMap {
 public:
  // `path` is the field's name so far ("port"), "" at the top. A node that is not a mapping is a
  // problem, and reads as an empty one.
  YamlMap(const YAML::Node& node, std::string path, std::string file,
          std::vector<Diagnostic>* problems);

  // All getters: false, and the output untouched, where the key is absent or wrong. Absence is a
  // problem when required; wrongness always is. NaN and infinities are wrong.
  bool GetNumber(std::string_view key, Need need, const Bounds& bounds, double* value);
  bool GetInteger(std::string_view key, Need need, std::int64_t low, std::int64_t high,
                  std::int64_t* value);
  bool GetBool(std::string_view key, Need need, bool* value);
  bool GetText(std::string_view key, Need need, std::string* value);
  bool GetNumbers(std::string_view key, Need need, std::vector<double>* values);
  bool GetVec3(std::string_view key, Need need, Vec3* value);
  // A mapping or list below; an undefined node where it is absent or no such thing.
  YAML::Node GetMap(std::string_view key, Need need);
  YAML::Node GetList(std::string_view key, Need need);

  bool Has(std::string_view key) const { return node_.IsMap() && node_[std::string(key)]; }
  // A key that is allowed here though nobody reads it.
  void Ignore(std::string_view key) { known_.push_back(std::string(key)); }

  // Adds a problem of the value of `key` (of the mapping itself: "").
  void AddProblem(std::string_view key, std::string problem, std::string fix,
                  Errc code = Errc::kInvalidArgument);
  // Reports the keys that no getter asked for, and those given twice. Call it last.
  void Finish();

  std::string PathOf(std::string_view key) const;
  const std::string& file() const { return file_; }
  std::vector<Diagnostic>* problems() const { return problems_; }

 private:
  YAML::Node Find(std::string_view key, Need need);
  int LineOf(std::string_view key) const;

  YAML::Node node_;
  std::string path_;
  std::string file_;
  std::vector<Diagnostic>* problems_;
  std::vector<std::string> known_;
};

// The whole file; kCorrupt with the line where it is not YAML at all.
IoExpected<YAML::Node> ParseYaml(const std::string& text, const std::string& file);

}  // namespace rsfm

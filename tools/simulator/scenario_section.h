// One section of a scenario file: reads what is there into variables that hold the defaults.
#pragma once

#include <yaml-cpp/yaml.h>

#include <initializer_list>
#include <string>

#include "rsfm/base/time.h"
#include "rsfm/io/text.h"
#include "rsfm/io/yaml_map.h"
#include "tools/simulator/scenario.h"

namespace rsfm::simulator {

inline constexpr Bounds kMetres{1e-3, 1e4, "give metres, from 0.001 to 10000"};
inline constexpr Bounds kLength{0.0, 1e4, "give metres, 0 or more"};
inline constexpr Bounds kDepth{0.1, 11000.0, "give metres below the surface, from 0.1 to 11000"};
inline constexpr Bounds kSigma{0.0, 1e3, "give a standard deviation, 0 or more"};
inline constexpr Bounds kShare{0.0, 1.0, "give a share from 0 to 1"};
inline constexpr Bounds kDegrees{-360.0, 360.0, "give degrees from -360 to 360"};
inline constexpr Bounds kSway{0.0, 60.0, "give degrees from 0 to 60"};
inline constexpr Bounds kSmallAngle{-45.0, 45.0, "give degrees from -45 to 45"};
inline constexpr Bounds kRate{1e-3, 1e3, "give a rate in Hz, from 0.001 to 1000"};
inline constexpr Bounds kSeconds{1e-3, 1e6, "give seconds, from 0.001 to 1000000"};
inline constexpr Bounds kDelay{-10.0, 10.0, "give seconds from -10 to 10"};
inline constexpr Bounds kElectrons{0.0, 1e7, "give electrons, from 0 to 10000000"};
inline constexpr double kMaxTankTexels = 2.5e8;

class Section {
 public:
  Section(YamlMap* parent, const char* key)
      : Section(parent->GetMap(key, Need::kOptional), parent->PathOf(key), parent) {}
  Section(const Section&) = delete;
  ~Section() {
    if (is_there_) map_.Finish();
  }

  void Get(const char* key, const Bounds& bounds, double* value) {
    if (is_there_) map_.GetNumber(key, Need::kOptional, bounds, value);
  }
  void Get(const char* key, bool* value) {
    if (is_there_) map_.GetBool(key, Need::kOptional, value);
  }
  void Get(const char* key, std::int64_t low, std::int64_t high, int* value) {
    std::int64_t number = 0;
    if (is_there_ && map_.GetInteger(key, Need::kOptional, low, high, &number)) {
      *value = static_cast<int>(number);
    }
  }
  void Get(const char* key, Utime* value) {
    if (is_there_) map_.GetInteger(key, Need::kOptional, 0, 4'000'000'000'000'000, value);
  }
  void GetVec3(const char* key, double low, double high, const char* fix, Vec3* value) {
    Vec3 read;
    if (!is_there_ || !map_.GetVec3(key, Need::kOptional, &read)) return;
    if ((read.array() < low).any() || (read.array() > high).any()) {
      map_.AddProblem(key, "is out of range", fix);
    } else {
      *value = read;
    }
  }
  void GetFile(const char* key, const std::filesystem::path& folder, std::filesystem::path* value) {
    std::string file;
    if (is_there_ && map_.GetText(key, Need::kOptional, &file)) *value = folder / file;
  }
  void GetVec2(const char* key, double low, double high, const char* fix, Vec2* value) {
    std::vector<double> read;
    if (!is_there_ || !map_.GetNumbers(key, Need::kOptional, &read)) return;
    if (read.size() != 2 || std::min(read[0], read[1]) < low || std::max(read[0], read[1]) > high) {
      map_.AddProblem(key, "is not two values in range", fix);
    } else {
      *value = Vec2(read[0], read[1]);
    }
  }
  // Which of several words.
  void GetChoice(const char* key, std::initializer_list<const char*> words, int* index) {
    std::string word;
    if (!is_there_ || !map_.GetText(key, Need::kOptional, &word)) return;
    std::string fix = "give ";
    int i = 0;
    for (const char* candidate : words) {
      if (word == candidate) {
        *index = i;
        return;
      }
      fix += (i == 0 ? "" : " or ") + std::string(candidate);
      ++i;
    }
    map_.AddProblem(key, Quoted(word) + " is not one of its values", fix);
  }
  // Which of two words.
  void GetWord(const char* key, const char* first, const char* second, bool* is_second) {
    std::string word;
    if (!is_there_ || !map_.GetText(key, Need::kOptional, &word)) return;
    if (word != first && word != second) {
      map_.AddProblem(key, Quoted(word) + " is not one of its values",
                      std::string("give ") + first + " or " + second);
    } else {
      *is_second = word == second;
    }
  }

  YamlMap& map() { return map_; }
  bool is_there() const { return is_there_; }

 private:
  // An absent section, or one that is no mapping (a problem already), reads as an empty one.
  Section(const YAML::Node& node, const std::string& path, YamlMap* parent)
      : map_(node ? node : YAML::Node(YAML::NodeType::Map), path, parent->file(),
             parent->problems()),
        is_there_(node.IsDefined()) {}

  YamlMap map_;
  bool is_there_;
};

// In scenario_scene.cc. `folder` is the scenario file's own, for the files that it names.
void ReadScene(YamlMap* root, const std::filesystem::path& folder, Scenario* scenario);
// After ReadScene: a tank is orbited unless the file says otherwise.
void ReadTrajectory(YamlMap* root, const std::filesystem::path& folder, Scenario* scenario);

}  // namespace rsfm::simulator

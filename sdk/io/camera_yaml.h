// The `camera` and `port` sections of a camera file, and calibmar's YAML. For sdk/io's own readers.
#pragma once

#include <string>

#include "rsfm/io/yaml_map.h"
#include "rsfm/refraction/camera_config.h"

namespace rsfm {

// Both read what is right and add a problem for the rest; the result counts only where no problem
// was added.
void ReadCameraSection(const YAML::Node& node, const std::string& file,
                       std::vector<Diagnostic>* problems, CameraConfig* camera);
void ReadPortSection(const YAML::Node& node, const std::string& file,
                     std::vector<Diagnostic>* problems, PortConfig* port);

// calibmar: model, parameters, non_svp_model, non_svp_parameters, width, height.
bool IsCalibmar(const YAML::Node& root);
void ReadCalibmar(const YAML::Node& root, const std::string& file,
                  std::vector<Diagnostic>* problems, CameraConfig* camera);

// What no single field shows: the camera outside its dome, a normal that is not unit, a port behind
// the camera. `prefix` names the section in messages ("port"), `line` its line.
void CheckPort(const PortConfig& port, const std::string& file, const std::string& prefix, int line,
               std::vector<Diagnostic>* problems);

// CheckPort and the range of every parameter, for formats that give the port as a row of numbers.
void CheckPortParams(const PortConfig& port, const std::string& file, const std::string& prefix,
                     int line, std::vector<Diagnostic>* problems);

// The lens models of this build, "PINHOLE, OPENCV, ...".
std::string LensModelNames();
// Sets model and parameters, or says what is wrong with them.
bool SetLens(const std::string& model, const std::vector<double>& params, CameraConfig* camera,
             std::string* field, std::string* problem, std::string* fix);

}  // namespace rsfm

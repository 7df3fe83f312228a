// The sections `capture` and `onboard` of rig.yaml. For sdk/io's own readers and writers.
#pragma once

#include <string>
#include <vector>

#include "rsfm/io/diagnostic.h"
#include "rsfm/io/onboard_options.h"
#include "rsfm/io/yaml_map.h"

namespace rsfm {

void ReadCaptureSection(const YAML::Node& node, const std::string& file,
                        std::vector<Diagnostic>* problems, CaptureOptions* capture);
void ReadOnboardSection(const YAML::Node& node, const std::string& file,
                        std::vector<Diagnostic>* problems, OnboardOptions* onboard);
// Empty where everything has its default.
std::string FormatCaptureSection(const CaptureOptions& capture);
std::string FormatOnboardSection(const OnboardOptions& onboard);

}  // namespace rsfm

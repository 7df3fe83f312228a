// rig.yaml, and every camera file that is YAML: whatever is in it, the answer is a rig that checks
// out or a list of problems.
#include "rsfm/io/rig.h"
#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace rsfm;
  std::vector<Diagnostic> problems;
  const auto rig = ParseRig(std::string(AsText(data, size)), "rig.yaml", &problems);
  Require(rig.has_value() == problems.empty());
  if (!rig) return 0;
  // What is written of it reads back.
  const std::filesystem::path path = FuzzFolder() / "rig.yaml";
  if (!WriteRig(*rig, path)) return 0;
  Require(ReadRig(path).has_value());
  return 0;
}

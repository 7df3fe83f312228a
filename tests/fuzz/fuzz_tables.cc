// nav.csv and images.csv: no NaN, no time that runs backwards comes out.
#include "rsfm/io/tables.h"
#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace rsfm;
  const std::filesystem::path path = FuzzFolder() / "table.csv";
  WriteFuzzFile(path, AsText(data, size));
  if (const auto images = ReadImageTimes(path)) {
    for (std::size_t i = 1; i < images->size(); ++i)
      Require((*images)[i - 1].utime < (*images)[i].utime);
  }
  const auto nav = ReadNavTable(path);
  if (!nav) return 0;
  for (std::size_t i = 0; i < nav->samples.size(); ++i) {
    const NavSample& s = nav->samples[i];
    Require(i == 0 || nav->samples[i - 1].utime <= s.utime);
    Require(!s.Has(NavField::kPosition) || s.position_ned_m.allFinite());
    Require(!s.Has(NavField::kAttitude) || std::abs(s.ned_from_body.norm() - 1.0) < 1e-6);
  }
  return 0;
}

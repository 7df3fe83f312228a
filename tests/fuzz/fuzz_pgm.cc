// PGM images of a replay. The input is width and height less 1, then the file.
#include "rsfm/io/pgm.h"
#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace rsfm;
  if (size < 2) return 0;
  const int width = 1 + data[0], height = 1 + data[1];
  const std::string file(AsText(data + 2, size - 2));
  const std::string_view pixels = PgmPixels(file, width, height);
  if (pixels.empty()) return 0;
  Require(pixels.size() == static_cast<std::size_t>(width * height));
  Require(pixels.data() >= file.data() &&
          pixels.data() + pixels.size() <= file.data() + file.size());
  // The same pixels behind the header that is written here.
  const std::string written = "P5\n" + std::to_string(width) + " " + std::to_string(height) +
                              "\n255\n" + std::string(pixels);
  Require(PgmPixels(written, width, height) == pixels);
  return 0;
}

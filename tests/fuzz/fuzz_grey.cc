// Buffers of a camera as grey images. The input is the format, width and height less 1 (two bytes
// each), the stride (four), then the buffer.
#include <algorithm>
#include <cstring>
#include <vector>

#include "rsfm_drivers/v4l2/grey.h"
#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  using namespace rsfm;
  constexpr std::size_t kHeader = 9, kGuard = 64, kMaxPixels = 1u << 22;
  constexpr std::uint8_t kUntouched = 0xa5;
  if (size < kHeader) return 0;
  RawFormat format;
  format.format = static_cast<PixelFormat>(bytes[0] % 8);
  format.width = 1 + bytes[1] + 256 * bytes[2];
  format.height = 1 + bytes[3] + 256 * bytes[4];
  std::memcpy(&format.stride_bytes, bytes + 5, 4);
  auto converter = GreyConverter::Create(format);
  const std::size_t pixels =
      static_cast<std::size_t>(format.width) * static_cast<std::size_t>(format.height);
  if (!converter || pixels > kMaxPixels) return 0;
  // Exactly as long as it is: no byte behind it may be read.
  const std::vector<std::uint8_t> raw(bytes + kHeader, bytes + size);
  std::vector<std::uint8_t> memory(pixels + 2 * kGuard, kUntouched);
  const Status status = converter->Convert(raw, memory.data() + kGuard);
  const auto is_untouched = [](std::uint8_t byte) { return byte == kUntouched; };
  Require(std::all_of(memory.begin(), memory.begin() + kGuard, is_untouched));
  Require(std::all_of(memory.end() - kGuard, memory.end(), is_untouched));
  if (format.format == PixelFormat::kMjpeg) return 0;
  Require(status.has_value() == (raw.size() >= format.MinBytes()));
  Require(status || std::all_of(memory.begin(), memory.end(), is_untouched));
  if (!status) return 0;
  // The last pixel, from the last row's last bytes.
  const std::size_t last =
      static_cast<std::size_t>(format.stride_bytes) * static_cast<std::size_t>(format.height - 1);
  const std::uint8_t* row = raw.data() + last;
  const std::uint8_t grey = memory[kGuard + pixels - 1];
  const int end = format.width - 1;
  switch (format.format) {
    case PixelFormat::kYuyv:
      Require(grey == row[2 * end]);
      break;
    case PixelFormat::kY16:
      Require(grey == row[2 * end + 1]);
      break;
    case PixelFormat::kY10:
      Require(grey == std::min((row[2 * end] + 256 * row[2 * end + 1]) / 4, 255));
      break;
    case PixelFormat::kBayer8: {
      const std::uint8_t* above = row - format.stride_bytes;
      Require(grey == (4 * (row[end] + row[end - 1] + above[end] + above[end - 1]) + 8) / 16);
      break;
    }
    default:
      Require(grey == row[end]);
  }
  return 0;
}

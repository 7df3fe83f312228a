// Images of an MJPEG camera: whatever arrives, no byte beside the image is touched, and the next
// good image decodes as ever.
#include <algorithm>
#include <vector>

#include "rsfm_drivers/jpeg/jpeg.h"
#include "tests/fuzz/fuzz.h"

namespace rsfm {
namespace {

constexpr int kWidth = 64, kHeight = 48;
constexpr std::size_t kGuard = 4096, kPixels = std::size_t{kWidth} * kHeight;
constexpr std::uint8_t kUntouched = 0xa5;

struct Good {
  std::vector<std::uint8_t> data, grey = std::vector<std::uint8_t>(kPixels);
};

Good MakeGood() {
  Good good;
  for (std::size_t i = 0; i < kPixels; ++i)
    good.grey[i] = static_cast<std::uint8_t>(i % kWidth * 3 + i / kWidth);
  auto encoder = JpegEncoder::Create(kWidth, kHeight);
  Require(encoder.has_value());
  const auto encoded = encoder->Encode(good.grey.data(), kWidth, 90);
  Require(encoded.has_value());
  good.data.assign(encoded->begin(), encoded->end());
  auto decoder = JpegDecoder::Create();
  Require(decoder && decoder->Decode(good.data, kWidth, kHeight, good.grey.data()));
  return good;
}

}  // namespace
}  // namespace rsfm

int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  using namespace rsfm;
  static const Good good = MakeGood();
  static auto decoder = JpegDecoder::Create();
  const std::vector<std::uint8_t> data(bytes, bytes + size);  // no byte behind it may be read
  std::vector<std::uint8_t> memory(kPixels + 2 * kGuard, kUntouched);
  std::uint8_t* grey = memory.data() + kGuard;
  const auto has_size = decoder->ReadSize(data);
  const bool is_ours = has_size && has_size->width == kWidth && has_size->height == kHeight;
  const Status status = decoder->Decode(data, kWidth, kHeight, grey);
  Require(is_ours || !status);
  const auto is_untouched = [](std::uint8_t byte) { return byte == kUntouched; };
  const auto begin = memory.begin(), end = memory.end();
  Require(std::all_of(begin, begin + kGuard, is_untouched));
  Require(std::all_of(end - kGuard, end, is_untouched));
  Require(is_ours || std::all_of(begin, end, is_untouched));
  std::vector<std::uint8_t> again(kPixels);
  if (status) {  // what is whole is whole every time
    Require(decoder->Decode(data, kWidth, kHeight, again.data()).has_value());
    Require(std::equal(again.begin(), again.end(), grey));
  }
  Require(decoder->Decode(good.data, kWidth, kHeight, again.data()).has_value());
  Require(again == good.grey);
  return 0;
}

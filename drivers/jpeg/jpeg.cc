#include "rsfm_drivers/jpeg/jpeg.h"

#include <turbojpeg.h>

#include <cstdio>

namespace rsfm {
namespace {

constexpr std::uint8_t kMarker = 0xff, kEndOfImage = 0xd9, kStartOfScan = 0xda;

// Bytes that a decoder has taken ahead of what it needs, and as many that may belong to the image
// and be equal to the padding.
constexpr std::size_t kMaxTakenAhead = 16;

// Where the coded rows begin, if a single scan holds the whole image, sequentially; else 0. Only
// then has the decoder written all rows before it looks for the end of the image.
//   [ITU-T T.81, B.1.1.2, B.2.2, B.2.3]
std::size_t StartOfOnlyScan(std::span<const std::uint8_t> data) {
  int num_components = 0;
  for (std::size_t at = 2; at + 10 <= data.size();) {
    if (data[at] != kMarker) return 0;
    const std::uint8_t marker = data[at + 1];
    if (marker == kMarker) {  // a fill byte
      ++at;
      continue;
    }
    const std::size_t length = static_cast<std::size_t>(data[at + 2]) << 8 | data[at + 3];
    if (marker == 0xc0 || marker == 0xc1) num_components = data[at + 9];
    if (marker == kStartOfScan)
      return num_components > 0 && data[at + 4] == num_components ? at + 2 + length : 0;
    at += 2 + length;
  }
  return 0;
}

// What was left over before the end of the image is padding, not coded rows that lost their place:
// one value throughout, and the decoder took none of it for rows.
bool IsPadding(std::span<const std::uint8_t> data, std::size_t num_left_over) {
  const std::size_t start = StartOfOnlyScan(data);
  if (start == 0) return false;
  std::size_t end = start;
  while (end + 1 < data.size() && !(data[end] == kMarker && data[end + 1] == kEndOfImage)) ++end;
  if (end + 1 >= data.size()) return false;
  while (end > start && data[end - 1] == kMarker) --end;  // fill bytes are not counted
  std::size_t num_equal = 0;
  while (end - num_equal > start && data[end - num_equal - 1] == data[end - 1]) ++num_equal;
  return num_equal >= num_left_over && num_equal - num_left_over <= kMaxTakenAhead;
}

}  // namespace

void JpegDecoder::Close::operator()(void* handle) const { tjDestroy(handle); }
void JpegEncoder::Close::operator()(void* handle) const { tjDestroy(handle); }

Expected<JpegDecoder> JpegDecoder::Create() {
  void* handle = tjInitDecompress();
  if (handle == nullptr) return Fail(Errc::kIo, "tjInitDecompress");
  return JpegDecoder(handle);
}

Expected<JpegDecoder::Size> JpegDecoder::ReadSize(std::span<const std::uint8_t> data) {
  // A handle keeps the tables of the image before, and its warnings: what an image lacks would come
  // from another. A new one takes less than a microsecond.
  handle_.reset(tjInitDecompress());
  if (handle_ == nullptr) return Fail(Errc::kIo, "tjInitDecompress");
  Size size;
  int subsampling = 0, colorspace = 0;
  if (tjDecompressHeader3(handle_.get(), data.data(), static_cast<unsigned long>(data.size()),
                          &size.width, &size.height, &subsampling, &colorspace) != 0) {
    return Fail(Errc::kCorrupt, "header");
  }
  return size;
}

Status JpegDecoder::Decode(std::span<const std::uint8_t> data, int width, int height,
                           std::uint8_t* grey) {
  const auto size = ReadSize(data);
  if (!size) return tl::unexpected(size.error());
  if (size->width != width || size->height != height) return Fail(Errc::kInvalidArgument, "size");
  // A warning (cut off, bad entropy code) is a failure too: such an image is partly made up. The
  // first ends it, so that no later one hides it.
  if (tjDecompress2(handle_.get(), data.data(), static_cast<unsigned long>(data.size()), grey,
                    width, width, height, TJPF_GRAY, TJFLAG_STOPONWARNING) == 0) {
    return {};
  }
  std::size_t num_left_over = 0;
  unsigned marker = 0;
  const bool is_padded = tjGetErrorCode(handle_.get()) == TJERR_WARNING &&
                         std::sscanf(tjGetErrorStr2(handle_.get()),
                                     "Corrupt JPEG data: %zu extraneous bytes before marker 0x%x",
                                     &num_left_over, &marker) == 2 &&
                         marker == kEndOfImage && IsPadding(data, num_left_over);
  return is_padded ? Status() : Fail(Errc::kCorrupt, "data");
}

Expected<JpegEncoder> JpegEncoder::Create(int width, int height) {
  if (width < 1 || height < 1 || width > 65500 || height > 65500)
    return Fail(Errc::kInvalidArgument, "size");
  void* handle = tjInitCompress();
  if (handle == nullptr) return Fail(Errc::kIo, "tjInitCompress");
  return JpegEncoder(handle, width, height,
                     static_cast<std::size_t>(tjBufSize(width, height, TJSAMP_GRAY)));
}

Expected<std::span<const std::uint8_t>> JpegEncoder::Encode(const std::uint8_t* grey,
                                                            int stride_bytes, int quality) {
  unsigned char* data = data_.get();
  auto size = static_cast<unsigned long>(capacity_);
  if (quality < 1 || quality > 100) return Fail(Errc::kInvalidArgument, "quality");
  if (tjCompress2(handle_.get(), grey, width_, stride_bytes, height_, TJPF_GRAY, &data, &size,
                  TJSAMP_GRAY, quality, TJFLAG_NOREALLOC) != 0) {
    return Fail(Errc::kIo, "tjCompress2");
  }
  return std::span<const std::uint8_t>(data, size);
}

}  // namespace rsfm

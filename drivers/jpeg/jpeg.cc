#include "rsfm_drivers/jpeg/jpeg.h"

#include <turbojpeg.h>

namespace rsfm {

void JpegDecoder::Close::operator()(void* handle) const { tjDestroy(handle); }
void JpegEncoder::Close::operator()(void* handle) const { tjDestroy(handle); }

Expected<JpegDecoder> JpegDecoder::Create() {
  void* handle = tjInitDecompress();
  if (handle == nullptr) return Fail(Errc::kIo, "tjInitDecompress");
  return JpegDecoder(handle);
}

// A warning stays in libjpeg-turbo's handle and fails the next header too: after a failure it is a
// new one.
Status JpegDecoder::Corrupt(const char* where) {
  handle_.reset(tjInitDecompress());
  return Fail(Errc::kCorrupt, where);
}

Expected<JpegDecoder::Size> JpegDecoder::ReadSize(std::span<const std::uint8_t> data) {
  if (handle_ == nullptr) handle_.reset(tjInitDecompress());
  if (handle_ == nullptr) return Fail(Errc::kIo, "tjInitDecompress");
  Size size;
  int subsampling = 0, colorspace = 0;
  if (tjDecompressHeader3(handle_.get(), data.data(), static_cast<unsigned long>(data.size()),
                          &size.width, &size.height, &subsampling, &colorspace) != 0) {
    return tl::unexpected(Corrupt("header").error());
  }
  return size;
}

Status JpegDecoder::Decode(std::span<const std::uint8_t> data, int width, int height,
                           std::uint8_t* grey) {
  const auto size = ReadSize(data);
  if (!size) return tl::unexpected(size.error());
  if (size->width != width || size->height != height) return Fail(Errc::kInvalidArgument, "size");
  // A warning (cut off, bad entropy code) is a failure too: such an image is partly made up.
  if (tjDecompress2(handle_.get(), data.data(), static_cast<unsigned long>(data.size()), grey,
                    width, width, height, TJPF_GRAY, 0) != 0) {
    return Corrupt("data");
  }
  return {};
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

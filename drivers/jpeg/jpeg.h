// Grey JPEG both ways, by libjpeg-turbo. Memory is taken once.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "rsfm/base/error.h"

namespace rsfm {

class JpegDecoder {
 public:
  // kIo when the library cannot be set up.
  static Expected<JpegDecoder> Create();

  struct Size {
    int width = 0;
    int height = 0;
  };
  // kCorrupt where the data is no JPEG.
  Expected<Size> ReadSize(std::span<const std::uint8_t> data);
  // The luminance, rows without padding. kInvalidArgument, nothing written, when the image is of
  // another size; kCorrupt for damaged or cut-off data, `grey` then holds what could be read. What
  // many cameras put before the end of the image, a run of one value, is no damage.
  Status Decode(std::span<const std::uint8_t> data, int width, int height, std::uint8_t* grey);

 private:
  struct Close {
    void operator()(void* handle) const;
  };
  explicit JpegDecoder(void* handle) : handle_(handle) {}

  std::unique_ptr<void, Close> handle_;
};

class JpegEncoder {
 public:
  // For images of one size. `quality` 1 to 100.
  static Expected<JpegEncoder> Create(int width, int height);

  // The data lies in the encoder until the next call. kInvalidArgument, kIo.
  Expected<std::span<const std::uint8_t>> Encode(const std::uint8_t* grey, int stride_bytes,
                                                 int quality);

 private:
  struct Close {
    void operator()(void* handle) const;
  };
  JpegEncoder(void* handle, int width, int height, std::size_t capacity)
      : handle_(handle),
        width_(width),
        height_(height),
        capacity_(capacity),
        data_(std::make_unique<std::uint8_t[]>(capacity)) {}

  std::unique_ptr<void, Close> handle_;
  int width_, height_;
  std::size_t capacity_;
  std::unique_ptr<std::uint8_t[]> data_;
};

}  // namespace rsfm

// What a camera delivers, as 8-bit grey.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>

#include "rsfm/base/error.h"
#include "rsfm/io/onboard_options.h"
#include "rsfm_drivers/jpeg/jpeg.h"

namespace rsfm {

struct RawFormat {
  PixelFormat format = PixelFormat::kGrey;  // never kAuto
  int width = 0;
  int height = 0;
  int stride_bytes = 0;  // from row to row; no meaning for kMjpeg

  // The least that a whole image has; 0 for kMjpeg.
  std::size_t MinBytes() const;
};

// One row each, `width` pixels. Written so that the compiler vectorises them.
void GreyFromYuyvRow(const std::uint8_t* raw, std::uint8_t* grey, int width);  // and Y16
void GreyFromY10Row(const std::uint8_t* raw, std::uint8_t* grey,
                    int width);  // brighter than 1023: 255
// Binomial 3 x 3 over the mosaic: a quarter red, a quarter blue and half green at every pixel,
// whatever the order of the filters. `sums` is scratch of `width` elements, width >= 2.
void GreyFromBayerRow(const std::uint8_t* above, const std::uint8_t* row, const std::uint8_t* below,
                      std::uint16_t* sums, std::uint8_t* grey, int width);

class GreyConverter {
 public:
  // kInvalidArgument: an image below 2 x 2 px, a stride below the row. The only place that
  // allocates (libjpeg-turbo's own decoding buffers for kMjpeg excepted).
  static Expected<GreyConverter> Create(const RawFormat& format);

  // Rows without padding into `grey`, width * height bytes. kNotEnoughData: the image is not whole,
  // nothing is written; kCorrupt, kInvalidArgument: see JpegDecoder::Decode.
  Status Convert(std::span<const std::uint8_t> raw, std::uint8_t* grey);

  const RawFormat& format() const { return format_; }

 private:
  explicit GreyConverter(const RawFormat& format) : format_(format) {}

  RawFormat format_;
  std::unique_ptr<std::uint16_t[]> sums_;  // kBayer8
  std::optional<JpegDecoder> jpeg_;        // kMjpeg
};

}  // namespace rsfm

#include "rsfm_drivers/v4l2/grey.h"

#include <cstring>
#include <limits>

#include "rsfm/base/vector_clones.h"

namespace rsfm {
namespace {

int RowBytes(const RawFormat& format) {
  switch (format.format) {
    case PixelFormat::kY16:
    case PixelFormat::kY10:
    case PixelFormat::kYuyv:
      return 2 * format.width;
    default:
      return format.width;
  }
}

}  // namespace

std::size_t RawFormat::MinBytes() const {
  if (format == PixelFormat::kMjpeg) return 0;
  const auto to_last_row = static_cast<std::size_t>(stride_bytes) * (height - 1);
  // Of NV12 only the luminance is read, but a frame without its colour is not whole.
  const std::size_t colour =
      format == PixelFormat::kNv12 ? static_cast<std::size_t>(stride_bytes) * (height / 2) : 0;
  return to_last_row + static_cast<std::size_t>(RowBytes(*this)) + colour;
}

RSFM_VECTOR_CLONES void GreyFromYuyvRow(const std::uint8_t* __restrict raw,
                                        std::uint8_t* __restrict grey, int width) {
  for (int x = 0; x < width; ++x) grey[x] = raw[2 * x];
}

RSFM_VECTOR_CLONES void GreyFromY10Row(const std::uint8_t* __restrict raw,
                                       std::uint8_t* __restrict grey, int width) {
  for (int x = 0; x < width; ++x) {
    const unsigned value =
        static_cast<unsigned>(raw[2 * x]) >> 2 | static_cast<unsigned>(raw[2 * x + 1]) << 6;
    grey[x] = static_cast<std::uint8_t>(value < 255u ? value : 255u);
  }
}

RSFM_VECTOR_CLONES void GreyFromBayerRow(const std::uint8_t* __restrict above,
                                         const std::uint8_t* __restrict row,
                                         const std::uint8_t* __restrict below,
                                         std::uint16_t* __restrict sums,
                                         std::uint8_t* __restrict grey, int width) {
  for (int x = 0; x < width; ++x)
    sums[x] = static_cast<std::uint16_t>(above[x] + 2 * row[x] + below[x]);
  for (int x = 1; x + 1 < width; ++x)
    grey[x] = static_cast<std::uint8_t>((sums[x - 1] + 2 * sums[x] + sums[x + 1] + 8) >> 4);
  // Mirrored at the borders, which keeps the filters' order.
  grey[0] = static_cast<std::uint8_t>((2 * sums[0] + 2 * sums[1] + 8) >> 4);
  grey[width - 1] = static_cast<std::uint8_t>((2 * sums[width - 1] + 2 * sums[width - 2] + 8) >> 4);
}

Expected<GreyConverter> GreyConverter::Create(const RawFormat& format) {
  if (format.width < 2 || format.height < 2 || format.width > 65536 || format.height > 65536)
    return Fail(Errc::kInvalidArgument, "size");
  if (format.format == PixelFormat::kAuto) return Fail(Errc::kInvalidArgument, "format");
  GreyConverter converter(format);
  if (format.format == PixelFormat::kMjpeg) {
    auto jpeg = JpegDecoder::Create();
    if (!jpeg) return tl::unexpected(jpeg.error());
    converter.jpeg_ = std::move(*jpeg);
    return converter;
  }
  // Of any format a row and a half of the stride for each row: that much must have a size.
  const std::uint64_t at_most = 3 * (static_cast<std::uint64_t>(format.stride_bytes) / 2 + 1) *
                                static_cast<std::uint64_t>(format.height);
  if (format.stride_bytes < RowBytes(format) ||
      at_most > std::numeric_limits<std::ptrdiff_t>::max())
    return Fail(Errc::kInvalidArgument, "stride_bytes");
  if (format.format == PixelFormat::kBayer8)
    converter.sums_ = std::make_unique<std::uint16_t[]>(static_cast<std::size_t>(format.width));
  return converter;
}

Status GreyConverter::Convert(std::span<const std::uint8_t> raw, std::uint8_t* grey) {
  const auto [format, width, height, stride] = format_;
  if (format == PixelFormat::kMjpeg) return jpeg_->Decode(raw, width, height, grey);
  if (raw.size() < format_.MinBytes())
    return Fail(Errc::kNotEnoughData, "bytes", static_cast<std::int32_t>(raw.size()));
  const auto row = [&, bytes = raw.data(), step = stride](int y) {
    return bytes + static_cast<std::ptrdiff_t>(y) * step;
  };
  for (int y = 0; y < height; ++y, grey += width) {
    switch (format) {
      case PixelFormat::kYuyv:
        GreyFromYuyvRow(row(y), grey, width);
        break;
      case PixelFormat::kY16:
        GreyFromYuyvRow(row(y) + 1, grey, width);  // the upper byte
        break;
      case PixelFormat::kY10:
        GreyFromY10Row(row(y), grey, width);
        break;
      case PixelFormat::kBayer8:
        GreyFromBayerRow(row(y > 0 ? y - 1 : 1), row(y), row(y + 1 < height ? y + 1 : height - 2),
                         sums_.get(), grey, width);
        break;
      default:
        std::memcpy(grey, row(y), static_cast<std::size_t>(width));
    }
  }
  return {};
}

}  // namespace rsfm

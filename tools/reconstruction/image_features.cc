#include "tools/reconstruction/image_features.h"

#include <cstring>

#include "rsfm/io/atomic_output.h"
#include "rsfm/io/binary.h"

namespace rsfm {
namespace {

constexpr std::uint64_t kMagic = 0x3154414546534652u;  // "RFSFEAT1"
constexpr std::size_t kHeaderBytes = 4 * sizeof(std::uint64_t);
constexpr std::size_t kRowBytes = 3 * sizeof(float) + 3;

}  // namespace

std::uint64_t Fingerprint(std::string_view bytes, std::uint64_t seed) {
  constexpr std::uint64_t kPrime = 0x100000001B3u;
  std::uint64_t hash = (0xCBF29CE484222325u ^ seed) * kPrime;
  std::size_t at = 0;
  for (; at + 8 <= bytes.size(); at += 8) {
    std::uint64_t word;
    std::memcpy(&word, bytes.data() + at, 8);
    hash = (hash ^ word) * kPrime;
    hash ^= hash >> 29;
  }
  for (; at < bytes.size(); ++at) hash = (hash ^ static_cast<unsigned char>(bytes[at])) * kPrime;
  hash = (hash ^ bytes.size()) * kPrime;
  return hash ^ (hash >> 32);
}

IoStatus WriteFeatures(const std::filesystem::path& path, std::uint64_t key,
                       const ImageFeatures& features) {
  std::string body;
  body.reserve(features.pixels.size() * kRowBytes + features.descriptors.size() + kHeaderBytes);
  for (std::size_t i = 0; i < features.pixels.size(); ++i) {
    AppendBinary(&body, static_cast<float>(features.pixels[i].x()));
    AppendBinary(&body, static_cast<float>(features.pixels[i].y()));
    AppendBinary(&body, features.sizes_px[i]);
    for (const std::uint8_t c : features.colours[i]) AppendBinary(&body, c);
  }
  body.append(reinterpret_cast<const char*>(features.descriptors.data()),
              features.descriptors.size());
  std::string bytes;
  AppendBinary(&bytes, kMagic);
  AppendBinary(&bytes, key);
  AppendBinary(&bytes, static_cast<std::uint32_t>(features.pixels.size()));
  AppendBinary(&bytes, static_cast<std::uint32_t>(features.type));
  AppendBinary(&bytes, Fingerprint(body, key));
  return WriteFileAtomically(path, bytes + body);
}

std::optional<ImageFeatures> ReadFeatures(const std::filesystem::path& path, std::uint64_t key) {
  std::error_code error;
  if (!std::filesystem::exists(path, error)) return std::nullopt;
  const auto bytes = ReadWholeFile(path);
  if (!bytes) return std::nullopt;
  BinaryReader reader(*bytes);
  std::uint64_t magic = 0, made_from = 0, sum = 0;
  std::uint32_t count = 0, type = 0;
  if (!reader.Read(&magic) || !reader.Read(&made_from) || !reader.Read(&count) ||
      !reader.Read(&type) || !reader.Read(&sum) || magic != kMagic || made_from != key ||
      type > static_cast<std::uint32_t>(DescriptorType::kAkaze))
    return std::nullopt;
  ImageFeatures features;
  features.type = static_cast<DescriptorType>(type);
  const std::size_t stride = static_cast<std::size_t>(DescriptorStride(features.type));
  const std::string_view body = std::string_view(*bytes).substr(kHeaderBytes);
  if (body.size() != count * (kRowBytes + stride) || Fingerprint(body, key) != sum)
    return std::nullopt;
  for (std::uint32_t i = 0; i < count; ++i) {
    float x = 0.0f, y = 0.0f, size = 0.0f;
    std::array<std::uint8_t, 3> colour = {};
    reader.Read(&x);
    reader.Read(&y);
    reader.Read(&size);
    for (std::uint8_t& c : colour) reader.Read(&c);
    features.pixels.emplace_back(x, y);
    features.sizes_px.push_back(size);
    features.colours.push_back(colour);
  }
  const auto* rows = reinterpret_cast<const std::uint8_t*>(body.data()) +
                     static_cast<std::size_t>(count) * kRowBytes;
  features.descriptors.assign(rows, rows + count * stride);
  return features;
}

}  // namespace rsfm

// Little-endian values in a buffer of bytes, as COLMAP's and PLY's binary files have them.
#pragma once

#include <bit>
#include <cstring>
#include <string>
#include <string_view>
#include <type_traits>

namespace rsfm {

static_assert(std::endian::native == std::endian::little, "COLMAP's files are little-endian");

template <class T>
void AppendBinary(std::string* bytes, T value) {
  static_assert(std::is_arithmetic_v<T>);
  char raw[sizeof(T)];
  std::memcpy(raw, &value, sizeof(T));
  bytes->append(raw, sizeof(T));
}

// Takes values from the front; after the first that is not whole, all reads fail.
class BinaryReader {
 public:
  explicit BinaryReader(std::string_view bytes) : bytes_(bytes) {}

  template <class T>
  bool Read(T* value) {
    static_assert(std::is_arithmetic_v<T>);
    if (!is_good_ || bytes_.size() - offset_ < sizeof(T)) return is_good_ = false;
    std::memcpy(value, bytes_.data() + offset_, sizeof(T));
    offset_ += sizeof(T);
    return true;
  }
  // Up to and without the next zero byte.
  bool ReadText(std::string* text) {
    const std::size_t end = is_good_ ? bytes_.find('\0', offset_) : std::string_view::npos;
    if (end == std::string_view::npos) return is_good_ = false;
    text->assign(bytes_.substr(offset_, end - offset_));
    offset_ = end + 1;
    return true;
  }
  // Whether `count` elements of that size can follow: to be asked before memory is taken for them.
  bool CanHold(std::uint64_t count, std::size_t element_bytes) const {
    return is_good_ && count <= (bytes_.size() - offset_) / element_bytes;
  }
  // A 64-bit count of elements of at least that size; false where so many cannot follow.
  bool ReadCount(std::size_t element_bytes, std::size_t* count) {
    std::uint64_t read = 0;
    if (!Read(&read) || !CanHold(read, element_bytes)) return is_good_ = false;
    *count = static_cast<std::size_t>(read);
    return true;
  }
  bool is_good() const { return is_good_; }
  bool AtEnd() const { return offset_ == bytes_.size(); }
  std::size_t offset() const { return offset_; }

 private:
  std::string_view bytes_;
  std::size_t offset_ = 0;
  bool is_good_ = true;
};

}  // namespace rsfm

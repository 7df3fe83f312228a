// Errors of the SDK: small values that never allocate, returned through tl::expected.
#pragma once

#include <cstdint>
#include <tl/expected.hpp>

namespace rsfm {

enum class Errc : std::uint8_t {
  kInvalidArgument,   // a value the caller passed is outside its domain
  kOutOfCapacity,     // a fixed-size container is full
  kNotFound,          // no such element
  kNotEnoughData,     // fewer measurements than the computation needs
  kNotEnoughInliers,  // a robust estimate found too little support
  kDegenerate,        // the geometry does not determine the answer
  kNotConverged,      // an iteration reached its bound
  kOutOfOrder,        // a time stamp runs backwards
  kUnsupported,       // a valid request this build or rig cannot serve
  kIo,                // the operating system refused
  kCorrupt,           // stored data is damaged
};

// `where` names the field or the operation and points to static storage; `detail` is a count or
// index that helps.
struct [[nodiscard]] Error {
  Errc code;
  const char* where = "";
  std::int32_t detail = 0;
};

template <class T>
using Expected = tl::expected<T, Error>;
using Status = Expected<void>;

inline tl::unexpected<Error> Fail(Errc code, const char* where = "", std::int32_t detail = 0) {
  return tl::unexpected<Error>(Error{code, where, detail});
}

// The code in words, for people: "invalid argument".
const char* ToString(Errc code) noexcept;

}  // namespace rsfm

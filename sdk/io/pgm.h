// Binary grey images as they lie in missions that were recorded without loss.
#pragma once

#include <string_view>

namespace rsfm {

// The pixels of a binary PGM of that size with 8 bits, rows without padding, within `bytes`. Empty:
// it is none.   [netpbm, pgm(5)]
std::string_view PgmPixels(std::string_view bytes, int width, int height);

}  // namespace rsfm

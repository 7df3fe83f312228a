#include "tests/support/malloc_trap.h"

#include <cerrno>
#include <cstdlib>

namespace rsfm {
namespace {

struct Counters {
  int depth;
  int paused;
  std::size_t count;
  std::size_t bytes;
};

// initial-exec: reaching the counters must not itself allocate.
thread_local constinit Counters counters __attribute__((tls_model("initial-exec"))) = {0, 0, 0, 0};

}  // namespace

MallocTrap::MallocTrap() {
  if (counters.depth++ == 0) counters.count = counters.bytes = 0;
}
MallocTrap::~MallocTrap() { --counters.depth; }
std::size_t MallocTrap::count() const { return counters.count; }
std::size_t MallocTrap::bytes() const { return counters.bytes; }
MallocTrapPause::MallocTrapPause() { ++counters.paused; }
MallocTrapPause::~MallocTrapPause() { --counters.paused; }

#ifndef RSFM_SANITIZED
namespace {

inline void Note(std::size_t bytes) {
  if (counters.depth > 0 && counters.paused == 0) [[unlikely]] {
    ++counters.count;
    counters.bytes += bytes;
  }
}

}  // namespace
#endif
}  // namespace rsfm

#ifndef RSFM_SANITIZED
// glibc's own allocator stays in charge: these only count and pass on.
extern "C" {
void* __libc_malloc(size_t);
void __libc_free(void*);
void* __libc_calloc(size_t, size_t);
void* __libc_realloc(void*, size_t);
void* __libc_memalign(size_t, size_t);

void* malloc(size_t bytes) {
  rsfm::Note(bytes);
  return __libc_malloc(bytes);
}
void free(void* pointer) { __libc_free(pointer); }
void* calloc(size_t count, size_t size) {
  rsfm::Note(count * size);
  return __libc_calloc(count, size);
}
void* realloc(void* pointer, size_t bytes) {
  rsfm::Note(bytes);
  return __libc_realloc(pointer, bytes);
}
void* memalign(size_t alignment, size_t bytes) {
  rsfm::Note(bytes);
  return __libc_memalign(alignment, bytes);
}
void* aligned_alloc(size_t alignment, size_t bytes) {
  rsfm::Note(bytes);
  return __libc_memalign(alignment, bytes);
}
int posix_memalign(void** result, size_t alignment, size_t bytes) {
  rsfm::Note(bytes);
  void* block = __libc_memalign(alignment, bytes);
  if (block == nullptr) return ENOMEM;
  *result = block;
  return 0;
}
}
#endif

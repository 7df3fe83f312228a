// Independent pieces of work on several threads.
#pragma once

#include <algorithm>
#include <atomic>
#include <thread>
#include <vector>

namespace rsfm::simulator {

// Calls body(i) for each i in [0, count), in any order, from up to num_threads threads. The result
// must not depend on the order; body must not throw.
template <class Body>
void ParallelFor(int count, int num_threads, const Body& body) {
  std::atomic<int> next = 0;
  const auto work = [&] {
    for (int i = next++; i < count; i = next++) body(i);
  };
  std::vector<std::jthread> threads;
  for (int i = 1; i < std::min(num_threads, count); ++i) threads.emplace_back(work);
  work();
}

}  // namespace rsfm::simulator

// Independent pieces of work on several threads.
#pragma once

#include <atomic>
#include <thread>
#include <vector>

namespace rsfm {

// Each thread calls make_worker() for a worker of its own, with what memory it needs, and
// worker(i) for some i in [0, count), in any order; a worker that returns false stops all. True
// when everything was done. The result must not depend on the order; workers must not throw.
template <class Index, class MakeWorker>
bool ParallelWork(Index count, int num_threads, const MakeWorker& make_worker) {
  std::atomic<Index> next = 0;
  std::atomic<bool> stopped = false;
  const auto work = [&] {
    auto worker = make_worker();
    for (Index i = next++; i < count && !stopped; i = next++)
      if (!worker(i)) stopped = true;
  };
  {
    std::vector<std::jthread> threads;
    for (int t = 1; t < num_threads && t < count; ++t) threads.emplace_back(work);
    work();
  }
  return !stopped;
}

// The same for a body that needs no memory of its own and never stops.
template <class Body>
void ParallelFor(int count, int num_threads, const Body& body) {
  ParallelWork(count, num_threads, [&body] {
    return [&body](int i) {
      body(i);
      return true;
    };
  });
}

}  // namespace rsfm

// Parallel work that tells how far it has come.
#pragma once

#include <functional>
#include <mutex>

#include "tools/common/parallel.h"

namespace rsfm {

// `make_worker()` is called once in each thread and gives a callable for the items 0 ... count - 1,
// each of which is handed out once. `progress(done, all)`, where there is one, is told one at a
// time; false stops. True when everything was done.
template <class MakeWorker>
bool ForEachInParallel(int count, int num_threads, const std::function<bool(int, int)>& progress,
                       const MakeWorker& make_worker) {
  int done = 0;
  std::mutex mutex;
  return ParallelWork(count, num_threads, [&] {
    return [&, worker = make_worker()](int i) mutable {
      worker(i);
      if (!progress) return true;
      const std::lock_guard<std::mutex> lock(mutex);
      return progress(++done, count);
    };
  });
}

}  // namespace rsfm

// How far a long piece of work has come: a bar that redraws itself on a terminal, a line now and
// then elsewhere (a log file, a CI job). And whether the user wants it to stop.
#pragma once

#include <chrono>
#include <cstdint>
#include <cstdio>
#include <mutex>
#include <string>
#include <string_view>

namespace rsfm {

class Progress {
 public:
  // `total` 0: unknown. Writes to `out`, which must outlive this.
  explicit Progress(std::string label, std::int64_t total = 0, std::FILE* out = stderr);
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;
  ~Progress();  // leaves the cursor on a fresh line

  // From any thread, as often as is convenient: prints at most ten times a second on a terminal,
  // and elsewhere at each tenth of the total or every ten seconds. `note` is shown behind the
  // count.
  void Update(std::int64_t done, std::string_view note = {});
  // The last line, always printed.
  void Finish(std::string_view note = {});

 private:
  void Print(std::int64_t done, std::string_view note, bool is_last);

  const std::string label_;
  const std::int64_t total_;
  std::FILE* const out_;
  const bool is_terminal_;
  const std::chrono::steady_clock::time_point start_;
  std::mutex mutex_;
  std::chrono::steady_clock::time_point last_print_;
  std::int64_t last_done_ = 0;
  std::int64_t last_tenth_ = 0;
  bool is_line_open_ = false;
  bool is_finished_ = false;
};

// After this, SIGINT and SIGTERM set the flag below once; the second one ends the process. Long
// loops ask IsInterrupted() and return, so that destructors remove what
// was written aside.
void CatchInterrupts();
bool IsInterrupted();

}  // namespace rsfm

#include "tools/common/progress.h"

#include <signal.h>
#include <unistd.h>

#include <algorithm>

namespace rsfm {
namespace {

volatile sig_atomic_t g_is_interrupted = 0;

void OnInterrupt(int) { g_is_interrupted = 1; }

std::string Duration(double seconds) {
  const auto whole = static_cast<long long>(seconds + 0.5);
  char text[32];
  if (whole < 60) {
    std::snprintf(text, sizeof text, "%llds", whole);
  } else if (whole < 3600) {
    std::snprintf(text, sizeof text, "%lldm%02llds", whole / 60, whole % 60);
  } else {
    std::snprintf(text, sizeof text, "%lldh%02lldm", whole / 3600, whole / 60 % 60);
  }
  return text;
}

}  // namespace

Progress::Progress(std::string label, std::int64_t total, std::FILE* out)
    : label_(std::move(label)),
      total_(total),
      out_(out),
      is_terminal_(::isatty(::fileno(out)) != 0),
      start_(std::chrono::steady_clock::now()),
      last_print_(start_) {}

Progress::~Progress() {
  if (is_line_open_) std::fputc('\n', out_);
}

void Progress::Update(std::int64_t done, std::string_view note) {
  using std::chrono::milliseconds;
  const std::scoped_lock lock(mutex_);
  if (is_finished_) return;
  last_done_ = done;
  const auto now = std::chrono::steady_clock::now();
  const std::int64_t tenth = total_ > 0 ? 10 * done / total_ : 0;
  const bool is_due = is_terminal_
                          ? now - last_print_ >= milliseconds(100)
                          : tenth > last_tenth_ || now - last_print_ >= milliseconds(10000);
  if (!is_due) return;
  last_tenth_ = tenth;
  last_print_ = now;
  Print(done, note, false);
}

void Progress::Finish(std::string_view note) {
  const std::scoped_lock lock(mutex_);
  if (is_finished_) return;
  is_finished_ = true;
  Print(std::max(last_done_, total_), note, true);
}

void Progress::Print(std::int64_t done, std::string_view note, bool is_last) {
  const double elapsed =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
  std::string line = label_;
  if (total_ > 0) {
    const double fraction =
        std::clamp(static_cast<double>(done) / static_cast<double>(total_), 0.0, 1.0);
    if (is_terminal_) {
      constexpr int kWidth = 30;
      const int filled = static_cast<int>(fraction * kWidth);
      line += " [" + std::string(filled, '#') + std::string(kWidth - filled, '.') + "]";
    }
    line += " " + std::to_string(done) + "/" + std::to_string(total_);
    if (!is_last && done > 0 && fraction > 0.0) {
      line += ", " + Duration(elapsed / fraction * (1.0 - fraction)) + " left";
    }
  } else if (done > 0) {
    line += " " + std::to_string(done);
  }
  if (is_last) line += ", " + Duration(elapsed);
  if (!note.empty()) line += ", " + std::string(note);
  if (is_terminal_) {
    std::fprintf(out_, "\r%s\x1b[K", line.c_str());
    is_line_open_ = !is_last;
    if (is_last) std::fputc('\n', out_);
  } else {
    std::fprintf(out_, "%s\n", line.c_str());
  }
  std::fflush(out_);
}

void CatchInterrupts() {
  struct sigaction action = {};
  action.sa_handler = OnInterrupt;
  action.sa_flags = static_cast<int>(SA_RESETHAND);
  ::sigaction(SIGINT, &action, nullptr);
  ::sigaction(SIGTERM, &action, nullptr);
}

bool IsInterrupted() { return g_is_interrupted != 0; }

}  // namespace rsfm

#include "tools/feed/adjustment_thread.h"

#include <utility>

namespace rsfm {

AdjustmentThread::AdjustmentThread(IncrementalMapper* mapper, std::function<void()> set_up)
    : mapper_(mapper), set_up_(std::move(set_up)), thread_([this] { Run(); }) {}

AdjustmentThread::~AdjustmentThread() {
  Wait();
  stop_ = true;
  wanted_.release();
  thread_.join();
}

void AdjustmentThread::Start() noexcept {
  is_started_ = true;
  wanted_.release();
}

void AdjustmentThread::Wait() noexcept {
  if (!std::exchange(is_started_, false)) return;
  done_.acquire();
}

void AdjustmentThread::Run() {
  set_up_();
  for (wanted_.acquire(); !stop_; wanted_.acquire()) {
    mapper_->AdjustWindow();
    done_.release();
  }
}

}  // namespace rsfm

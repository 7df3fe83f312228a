// Progress of work in stages: one bar after another, as the work changes.
#pragma once

#include <memory>
#include <string>

#include "tools/common/progress.h"

namespace rsfm {

class StageProgress {
 public:
  // What is being done, how far (0 ... 1). False when the user wants it to stop.
  bool Update(const std::string& stage, double part) {
    if (stage != stage_) {
      if (progress_) progress_->Finish();
      progress_ = std::make_unique<Progress>(stage, 100);
      stage_ = stage;
    }
    progress_->Update(static_cast<std::int64_t>(100.0 * part));
    return !IsInterrupted();
  }

 private:
  std::string stage_;
  std::unique_ptr<Progress> progress_;
};

}  // namespace rsfm

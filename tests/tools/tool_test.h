// rsfm_tool in a folder of its own.
#pragma once

#include <gtest/gtest.h>

#include <string>

#include "rsfm/io/atomic_output.h"
#include "tests/support/run_program.h"

namespace rsfm {

class ToolTest : public ::testing::Test {
 protected:
  std::string Path(const std::string& name) const { return (folder_.path() / name).string(); }
  std::string Write(const std::string& name, const std::string& content) const {
    EXPECT_TRUE(WriteFileAtomically(Path(name), content));
    return Path(name);
  }
  static ProgramResult Run(const std::string& arguments, const std::string& input = {}) {
    return RunProgram(std::string(RSFM_TOOL) + " " + arguments, input);
  }

  TemporaryFolder folder_;
};

}  // namespace rsfm

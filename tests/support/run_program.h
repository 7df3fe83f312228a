// Runs a built program as a user would, and keeps what it printed.
#pragma once

#include <stdlib.h>
#include <sys/wait.h>

#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>

#include "tests/support/temporary_folder.h"

namespace rsfm {

struct ProgramResult {
  int exit_code = -1;  // -1: ended by a signal
  std::string out, err;
};

// `command` is a shell's command line. Standard input is `input`.
inline ProgramResult RunProgram(const std::string& command, const std::string& input = {}) {
  const TemporaryFolder folder;
  const auto read = [&](const char* name) {
    std::ifstream file(folder.path() / name, std::ios::binary);
    std::stringstream content;
    content << file.rdbuf();
    return content.str();
  };
  std::ofstream(folder.path() / "in", std::ios::binary) << input;
  const std::string base = folder.path().string();
  const int status = std::system(
      ("{ " + command + "; } <" + base + "/in >" + base + "/out 2>" + base + "/err").c_str());
  ProgramResult result;
  if (WIFEXITED(status)) result.exit_code = WEXITSTATUS(status);
  result.out = read("out");
  result.err = read("err");
  return result;
}

}  // namespace rsfm

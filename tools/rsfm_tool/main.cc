// rsfm_tool: the desk. One file per verb: Declare<Verb>() says its arguments, Run<Verb>() does it.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <exception>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "tools/common/exit.h"
#include "tools/common/progress.h"
#include "tools/rsfm_tool/verb_backproject.h"
#include "tools/rsfm_tool/verb_camera.h"
#include "tools/rsfm_tool/verb_check.h"
#include "tools/rsfm_tool/verb_evaluate.h"
#include "tools/rsfm_tool/verb_evaluate_solvers.h"
#include "tools/rsfm_tool/verb_export.h"
#include "tools/rsfm_tool/verb_info.h"
#include "tools/rsfm_tool/verb_map.h"
#include "tools/rsfm_tool/verb_project.h"
#include "tools/rsfm_tool/verb_reconstruct.h"
#include "tools/rsfm_tool/verb_refine.h"
#include "tools/rsfm_tool/verb_report.h"
#include "tools/rsfm_tool/verb_simulate.h"

namespace rsfm {
namespace {

class Verbs {
 public:
  explicit Verbs(CLI::App* app) : app_(app) {}

  template <class Options>
  void Add(CLI::App* (*declare)(CLI::App&, Options*), int (*run)(const Options&)) {
    auto options = std::make_shared<Options>();
    CLI::App* verb = declare(*app_, options.get());
    verbs_.push_back({verb, [options, run] { return run(*options); }});
  }

  bool Has(const std::string& name) const {
    return std::any_of(verbs_.begin(), verbs_.end(),
                       [&](const Verb& verb) { return verb.app->get_name() == name; });
  }

  int RunParsed() const {
    for (const Verb& verb : verbs_) {
      if (verb.app->parsed()) return verb.run();
    }
    return kExitWrongRequest;
  }

 private:
  struct Verb {
    CLI::App* app;
    std::function<int()> run;
  };
  CLI::App* app_;
  std::vector<Verb> verbs_;
};

int Main(int argc, char** argv) {
  CLI::App app("Refractive odometry and mapping for underwater vehicles: the desk's tool",
               "rsfm_tool");
  app.require_subcommand(1);
  app.set_version_flag("--version", RSFM_VERSION);
  Verbs verbs(&app);
  verbs.Add(DeclareBackproject, RunBackproject);
  verbs.Add(DeclareCamera, RunCamera);
  verbs.Add(DeclareCheck, RunCheck);
  verbs.Add(DeclareEvaluate, RunEvaluate);
  verbs.Add(DeclareEvaluateSolvers, RunEvaluateSolvers);
  verbs.Add(DeclareExport, RunExport);
  verbs.Add(DeclareInfo, RunInfo);
  verbs.Add(DeclareMap, RunMap);
  verbs.Add(DeclareProject, RunProject);
  verbs.Add(DeclareReconstruct, RunReconstruct);
  verbs.Add(DeclareRefine, RunRefine);
  verbs.Add(DeclareReport, RunReport);
  verbs.Add(DeclareSimulate, RunSimulate);

  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) return app.exit(error);  // --help, --version
    if (argc > 1 && argv[1][0] != '-' && !verbs.Has(argv[1])) {
      std::fprintf(stderr, "error: '%s' is not a verb; see rsfm_tool --help\n", argv[1]);
      return kExitWrongRequest;
    }
    std::fprintf(stderr, "error: %s; see rsfm_tool --help\n", error.what());
    return kExitWrongRequest;
  }
  CatchInterrupts();
  return verbs.RunParsed();
}

}  // namespace
}  // namespace rsfm

int main(int argc, char** argv) {
  try {
    return rsfm::Main(argc, argv);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "error: %s\n", error.what());
    return rsfm::kExitFailed;
  }
}

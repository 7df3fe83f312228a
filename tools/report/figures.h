// The figures of a report.
#pragma once

#include <string>
#include <vector>

#include "tools/report/plot.h"
#include "tools/report/report_data.h"

namespace rsfm {

struct Figure {
  std::string name;     // file name without extension: "trajectory"
  std::string caption;  // one sentence
  Plot plot;
};

// Only those for which there is something to show.
std::vector<Figure> MakeFigures(const ReportData& data);

}  // namespace rsfm

// A report folder: index.html with everything in it, and each figure as SVG and PNG.
#pragma once

#include "tools/report/report_data.h"

namespace rsfm {

// Creates the folder where it is missing; each file is written aside and renamed. Returns what was
// reported on.
IoExpected<ReportData> WriteReport(const ReportRequest& request, const std::filesystem::path& out);

}  // namespace rsfm

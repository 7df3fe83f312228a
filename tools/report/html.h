// The page of a report: one file with everything in it.
#pragma once

#include <string>

#include "tools/report/figures.h"

namespace rsfm {

std::string FormatHtml(const ReportData& data, const std::vector<Figure>& figures);

}  // namespace rsfm

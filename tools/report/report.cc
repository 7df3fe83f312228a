#include "tools/report/report.h"

#include "rsfm/io/atomic_output.h"
#include "tools/report/html.h"

namespace rsfm {

IoExpected<ReportData> WriteReport(const ReportRequest& request, const std::filesystem::path& out) {
  auto data = ReadReportData(request);
  if (!data) return data;
  const std::vector<Figure> figures = MakeFigures(*data);
  for (const Figure& figure : figures) {
    const auto png = figure.plot.Png();
    if (!png) return Fail(png.error());
    if (auto status = WriteFileAtomically(out / (figure.name + ".svg"), figure.plot.Svg());
        !status) {
      return Fail(status.error());
    }
    if (auto status = WriteFileAtomically(out / (figure.name + ".png"), *png); !status) {
      return Fail(status.error());
    }
  }
  const std::string html = FormatHtml(*data, figures);
  if (auto status = WriteFileAtomically(out / "index.html", html); !status) {
    return Fail(status.error());
  }
  return data;
}

}  // namespace rsfm

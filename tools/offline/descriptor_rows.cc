#include "tools/offline/descriptor_rows.h"

#include <algorithm>
#include <numeric>
#include <utility>

namespace rsfm {

DescriptorView DescriptorRows::View(const std::vector<std::uint8_t>& rows) const {
  const int stride = std::max(1, DescriptorStride(type));
  return {rows.data(), static_cast<int>(rows.size()) / stride, type};
}

DescriptorRows PrepareDescriptors(DescriptorType type, std::vector<std::uint8_t> all,
                                  std::span<const float> sizes_px, int preview_features) {
  DescriptorRows prepared;
  prepared.type = type;
  prepared.all = std::move(all);
  const DescriptorView view = prepared.All();
  std::vector<int> order(static_cast<std::size_t>(view.count));
  std::iota(order.begin(), order.end(), 0);
  if (sizes_px.size() == order.size()) {
    std::stable_sort(order.begin(), order.end(),
                     [sizes_px](int a, int b) { return sizes_px[a] > sizes_px[b]; });
  }
  order.resize(std::min(order.size(), static_cast<std::size_t>(preview_features)));
  for (const int i : order)
    prepared.preview.insert(prepared.preview.end(), view.Row(i),
                            view.Row(i) + DescriptorStride(type));
  return prepared;
}

}  // namespace rsfm

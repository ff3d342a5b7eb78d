#include "perception/checkpoint/yolov13_scale.h"

#include <algorithm>
#include <cmath>

#include "core/check.h"
#include "core/error.h"

namespace segsim::perception::yolov13 {
namespace {

constexpr std::string_view kPrefix = "yolov13-", kVersion = "/1";

constexpr ScaleTable kTables[] = {
    {'n', 0.5, 0.25, 1024, 4, false, 2.0, 2'494'151, 898, 6.4},
    {'s', 0.5, 0.5, 1024, 8, false, 2.0, 9'055'527, 898, 20.8},
    {'l', 1.0, 1.0, 512, 8, true, 1.5, 27'627'783, 1568, 88.4},
    {'x', 1.0, 1.5, 512, 12, true, 1.5, 64'057'511, 1568, 199.2},
};

}  // namespace

int ScaleTable::channels(int nominal) const {
  return 8 * static_cast<int>(std::ceil(std::min(nominal, max_channels) * width / 8.0));
}

int ScaleTable::repeats(int nominal) const {
  if (nominal <= 1) return nominal;
  return std::max(1, static_cast<int>(std::nearbyint(nominal * depth)));
}

const ScaleTable& table_of(Scale scale) {
  const auto index = static_cast<std::size_t>(scale);
  SEGSIM_CHECK(index < std::size(kTables), std::to_string(index));
  return kTables[index];
}

std::string architecture_of(Scale scale) {
  return std::string(kPrefix) + table_of(scale).letter + std::string(kVersion);
}

bool is_architecture(std::string_view architecture) {
  return architecture.substr(0, kPrefix.size()) == kPrefix;
}

Scale scale_of_architecture(std::string_view architecture, const std::string& place) {
  for (const Scale scale : kAllScales) {
    if (architecture == architecture_of(scale)) return scale;
  }
  throw core::InputError::expected(place + ": architecture",
                                   "yolov13-n/1, yolov13-s/1, yolov13-l/1 or yolov13-x/1",
                                   std::string(architecture));
}

}  // namespace segsim::perception::yolov13

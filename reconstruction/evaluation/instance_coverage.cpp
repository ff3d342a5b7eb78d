#include "reconstruction/evaluation/instance_coverage.h"

#include <map>
#include <set>

#include "reconstruction/evaluation/internal/segments.h"

namespace segsim::reconstruction {
namespace {

/// Pixels of each predicted id on one true object.
struct TrueObject {
  std::uint64_t pixels = 0;
  std::map<std::uint16_t, std::uint64_t> covered_by;
};

}  // namespace

CoverageQuality instance_coverage(const ContingencyTable& table,
                                  std::span<const core::SceneClass> classes,
                                  const CoverageRules& rules) {
  const std::vector<Overlap> overlaps = table.scene();
  const internal::Segmentation truth =
      internal::segments_by_id(internal::truth_pixels(overlaps), classes);
  std::map<std::uint16_t, TrueObject> objects;
  std::map<std::uint16_t, std::uint64_t> predicted_pixels;
  for (const Overlap& cell : overlaps) {
    predicted_pixels[cell.predicted.instance_id] += cell.pixels;
    const int segment = truth.index.at(cell.truth);
    if (segment == internal::kVoid ||
        !truth.segments[static_cast<std::size_t>(segment)].thing_instance) {
      continue;
    }
    TrueObject& object = objects[cell.truth.instance_id];
    object.pixels += cell.pixels;
    object.covered_by[cell.predicted.instance_id] += cell.pixels;
  }

  CoverageQuality result;
  std::set<std::uint16_t> ids_on_objects;
  double pixels = 0.0, covered = 0.0;
  for (const auto& [id, object] : objects) {
    InstanceCoverage entry{id, 0, object.pixels, 0.0};
    std::uint64_t most = 0;
    for (const auto& [predicted_id, common] : object.covered_by) {  // Ascending: ties keep it.
      if (predicted_id == 0 && !rules.zero_id_may_cover) continue;
      ids_on_objects.insert(predicted_id);
      if (common > most) most = common, entry.predicted_id = predicted_id;
    }
    if (most > 0) {
      entry.coverage =
          static_cast<double>(most) /
          static_cast<double>(predicted_pixels[entry.predicted_id] + object.pixels - most);
    }
    result.mean += entry.coverage;
    result.weighted += entry.coverage * static_cast<double>(object.pixels);
    pixels += static_cast<double>(object.pixels);
    covered += entry.coverage > rules.min_coverage ? 1.0 : 0.0;
    result.instances.push_back(entry);
  }
  if (objects.empty()) return result;
  result.mean /= static_cast<double>(objects.size());
  result.weighted /= pixels;
  result.recall = covered / static_cast<double>(objects.size());
  if (!ids_on_objects.empty()) {
    result.precision = covered / static_cast<double>(ids_on_objects.size());
  }
  return result;
}

}  // namespace segsim::reconstruction

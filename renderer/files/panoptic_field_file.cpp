#include "renderer/files/panoptic_field_file.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "core/check.h"
#include "core/error.h"
#include "renderer/files/internal/checked_file.h"

namespace segsim::renderer {
namespace {

using core::InputError;
using internal::ByteReader;
using internal::ByteWriter;

constexpr std::string_view kMagic = "SEGSIMLD";
constexpr std::uint32_t kVersion = 1;
constexpr std::uint32_t kMostIds = 65536;
constexpr std::uint32_t kMostEntries = 1024;  // Of a row: bounds memory.

void put_row(const SparseScores& scores, std::size_t surfel, ByteWriter& out) {
  const auto row = scores.row(surfel);
  out.put(scores.base(surfel));
  out.put(static_cast<std::uint16_t>(row.size()));
  for (const SparseScores::Entry& entry : row) {
    out.put(entry.index);
    out.put(entry.excess);
  }
}

/// @param ids  Indices are below it.
void take_row(ByteReader& in, const std::string& place, std::size_t ids, std::size_t surfel,
              SparseScores& scores, std::vector<SparseScores::Entry>& row) {
  const auto refuse = [&](const std::string& expected, const std::string& found) {
    throw InputError::expected(place + ": surfel " + std::to_string(surfel), expected, found);
  };
  const auto base = in.take<float>();
  if (!std::isfinite(base)) refuse("a finite score", std::to_string(base));
  const auto count = in.take<std::uint16_t>();
  if (count > scores.row_capacity()) {
    refuse(std::to_string(scores.row_capacity()) + " entries at most", std::to_string(count));
  }
  row.clear();
  for (std::uint16_t i = 0; i < count; ++i) {
    SparseScores::Entry entry{};
    entry.index = in.take<std::uint16_t>();
    entry.excess = in.take<float>();
    if (entry.index >= ids) {
      refuse("an index below " + std::to_string(ids), std::to_string(entry.index));
    }
    if (!(entry.excess >= 0.0F) || !std::isfinite(entry.excess)) {
      refuse("a share >= 0", std::to_string(entry.excess));
    }
    row.push_back(entry);
  }
  scores.set(surfel, base, row);
}

std::uint32_t take_count(ByteReader& in, const std::string& place, const char* what,
                         std::uint32_t most) {
  const auto count = in.take<std::uint32_t>();
  if (count > most) {
    throw InputError::expected(place, std::to_string(most) + " " + what + " at most",
                               std::to_string(count));
  }
  return count;
}

}  // namespace

void write_panoptic_field(const std::filesystem::path& file, const PanopticField& field) {
  SEGSIM_CHECK(field.classes.size() == field.instances.size(), "a field of equal halves");
  SEGSIM_CHECK(
      std::max(field.classes.row_capacity(), field.instances.row_capacity()) <= kMostEntries,
      "entries of a row");
  SEGSIM_CHECK(field.class_is_thing.size() == field.class_id.size(), "kinds of classes");
  const bool with_classes = !field.instance_class.empty();
  SEGSIM_CHECK(!with_classes || field.instance_class.size() == field.instance_id.size(),
               "classes of instances");
  ByteWriter out;
  out.put(static_cast<std::uint32_t>(field.size()));
  out.put(static_cast<std::uint32_t>(field.class_id.size()));
  out.put(static_cast<std::uint32_t>(field.instance_id.size()));
  out.put(static_cast<std::uint32_t>(field.classes.row_capacity()));
  out.put(static_cast<std::uint32_t>(field.instances.row_capacity()));
  out.put(static_cast<std::uint32_t>(with_classes ? 1 : 0));
  for (const DroppedMass& mass : {field.dropped_classes, field.dropped_instances}) {
    out.put(mass.mean);
    out.put(mass.max);
  }
  for (std::size_t c = 0; c < field.class_id.size(); ++c) {
    out.put(field.class_id[c]);
    out.put(static_cast<std::uint16_t>(field.class_is_thing[c]));
  }
  for (std::size_t i = 0; i < field.instance_id.size(); ++i) {
    out.put(field.instance_id[i]);
    out.put(with_classes ? field.instance_class[i] : std::uint16_t{0});
  }
  for (std::size_t s = 0; s < field.size(); ++s) {
    put_row(field.classes, s, out);
    put_row(field.instances, s, out);
  }
  internal::write_checked_file(file, kMagic, kVersion, out.bytes);
}

PanopticField read_panoptic_field(const std::filesystem::path& file, std::size_t surfels) {
  const std::string place = file.string();
  const std::string payload =
      internal::read_checked_file(file, kMagic, "label distributions", kVersion).payload;
  ByteReader in(payload, place);
  const auto count = in.take<std::uint32_t>();
  if (count != surfels) {
    throw InputError::expected(place,
                               "distributions of " + std::to_string(surfels) + " surfels",
                               std::to_string(count));
  }
  const std::uint32_t classes = take_count(in, place, "classes", kMostIds);
  const std::uint32_t instances = take_count(in, place, "instances", kMostIds);
  const std::uint32_t class_entries =
      take_count(in, place, "classes of a surfel", std::min(classes, kMostEntries));
  const std::uint32_t instance_entries =
      take_count(in, place, "instances of a surfel", std::min(instances, kMostEntries));
  const bool with_classes = take_count(in, place, "(a flag)", 1) == 1;
  PanopticField field;
  for (DroppedMass* mass : {&field.dropped_classes, &field.dropped_instances}) {
    mass->mean = in.take<double>();
    mass->max = in.take<double>();
  }
  for (std::uint32_t c = 0; c < classes; ++c) {
    field.class_id.push_back(in.take<std::uint16_t>());
    const auto thing = in.take<std::uint16_t>();
    if (thing > 1) throw InputError::expected(place, "thing 0 or 1", std::to_string(thing));
    field.class_is_thing.push_back(static_cast<std::uint8_t>(thing));
  }
  for (std::uint32_t i = 0; i < instances; ++i) {
    field.instance_id.push_back(in.take<std::uint16_t>());
    const auto class_id = in.take<std::uint16_t>();
    if (with_classes) field.instance_class.push_back(class_id);
  }
  field.classes = SparseScores(surfels, class_entries);
  field.instances = SparseScores(surfels, instance_entries);
  std::vector<SparseScores::Entry> row;
  for (std::size_t s = 0; s < surfels; ++s) {
    take_row(in, place, classes, s, field.classes, row);
    take_row(in, place, instances, s, field.instances, row);
  }
  in.expect_end();
  return field;
}

}  // namespace segsim::renderer

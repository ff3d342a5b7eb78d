#include "renderer/files/label_edits.h"

#include <algorithm>
#include <map>
#include <string>

#include "core/check.h"
#include "core/error.h"
#include "renderer/files/internal/checked_file.h"

namespace segsim::renderer {
namespace {

constexpr std::string_view kMagic = "SEGSIMLE";
constexpr std::uint32_t kVersion = 1;

using Entry = SparseScores::Entry;

/// Where an id is in a field's list; it is appended if it is not there.
template <class Append>
std::uint16_t index_of(const std::vector<std::uint16_t>& ids, std::uint16_t id,
                       const Append& append) {
  const auto found = std::find(ids.begin(), ids.end(), id);
  const auto index = static_cast<std::size_t>(found - ids.begin());
  SEGSIM_CHECK(index < 65535, "classes or instances of a field");
  if (found == ids.end()) append();
  return static_cast<std::uint16_t>(index);
}

/// Scores with room for one entry of a surfel at least.
SparseScores with_room(const SparseScores& scores) {
  if (scores.row_capacity() > 0) return scores;
  SparseScores roomy(scores.size(), 1);
  for (std::size_t s = 0; s < scores.size(); ++s) roomy.set(s, scores.base(s), {});
  return roomy;
}

class FieldEditor {
 public:
  explicit FieldEditor(PanopticField& field) : field_(field) {
    field_.classes = with_room(field_.classes);
    field_.instances = with_room(field_.instances);
  }

  /// Entries of `from` become entries of `to`; of two for one instance, one.
  void move(const std::vector<LabelEdits::Move>& moves) {
    std::map<std::uint16_t, int> target;  // By index; -1: dropped.
    for (const LabelEdits::Move& m : moves) {
      const auto& ids = field_.instance_id;
      if (std::find(ids.begin(), ids.end(), m.from) == ids.end()) continue;
      target[instance_index(m.from)] = m.to == 0 ? -1 : instance_index(m.to);
    }
    if (target.empty()) return;
    for (std::size_t s = 0; s < field_.size(); ++s) move_row(s, target);
  }

  void set(const LabelEdits::Run& run) {
    const std::uint16_t of_class = index_of(field_.class_id, run.class_id, [&] {
      field_.class_id.push_back(run.class_id);
      field_.class_is_thing.push_back(run.instance_id != 0 ? 1 : 0);
    });
    const Entry all_of_class{of_class, 1.0F};
    std::vector<Entry> of_instance;
    if (run.instance_id != 0) {
      const std::uint16_t index = instance_index(run.instance_id);
      if (!field_.instance_class.empty()) field_.instance_class[index] = run.class_id;
      of_instance = {{index, 1.0F}};
    } else {
      // The score of "no instance", in fields that have one.
      const auto none =
          std::find(field_.instance_id.begin(), field_.instance_id.end(), std::uint16_t{0});
      if (none != field_.instance_id.end()) {
        of_instance = {{static_cast<std::uint16_t>(none - field_.instance_id.begin()), 1.0F}};
      }
    }
    for (std::size_t s = run.first; s < std::size_t{run.first} + run.count; ++s) {
      field_.classes.set(s, 0.0F, {&all_of_class, 1});
      field_.instances.set(s, 0.0F, of_instance);
    }
  }

 private:
  std::uint16_t instance_index(std::uint16_t id) {
    return index_of(field_.instance_id, id, [&] {
      field_.instance_id.push_back(id);
      if (!field_.instance_class.empty()) field_.instance_class.push_back(0);
    });
  }

  void move_row(std::size_t surfel, const std::map<std::uint16_t, int>& target) {
    const auto row = field_.instances.row(surfel);
    if (std::none_of(row.begin(), row.end(),
                     [&](const Entry& entry) { return target.contains(entry.index); })) {
      return;
    }
    std::vector<Entry> moved;
    for (const Entry& entry : row) {
      const auto found = target.find(entry.index);
      const int index = found == target.end() ? entry.index : found->second;
      if (index < 0) continue;
      const auto same = std::find_if(moved.begin(), moved.end(),
                                     [&](const Entry& other) { return other.index == index; });
      if (same != moved.end()) {
        same->excess += entry.excess;
      } else {
        moved.push_back({static_cast<std::uint16_t>(index), entry.excess});
      }
    }
    std::stable_sort(moved.begin(), moved.end(),
                     [](const Entry& a, const Entry& b) { return a.excess > b.excess; });
    field_.instances.set(surfel, field_.instances.base(surfel), moved);
  }

  PanopticField& field_;
};

void check_order(const LabelEdits& edits, std::size_t surfels, const std::string& place) {
  std::size_t end = 0;
  for (const LabelEdits::Run& run : edits.runs) {
    const std::size_t run_end = std::size_t{run.first} + run.count;
    if (run.count == 0 || run.first < end || run_end > surfels) {
      throw core::InputError::expected(
          place, "ascending runs of " + std::to_string(surfels) + " surfels",
          "one of " + std::to_string(run.count) + " from " + std::to_string(run.first));
    }
    end = run_end;
  }
  std::uint16_t last = 0;
  for (const LabelEdits::Move& move : edits.moves) {
    if (move.from <= last) {
      throw core::InputError::expected(
          place, "moves of ascending instances",
          std::to_string(move.from) + " after " + std::to_string(last));
    }
    last = move.from;
  }
}

}  // namespace

void apply_label_edits(const LabelEdits& edits, SurfelCloud& surfels, PanopticField* field) {
  SEGSIM_CHECK(surfels.has_labels() || edits.empty(), "edits of surfels without labels");
  for (const LabelEdits::Run& run : edits.runs) {
    SEGSIM_CHECK(std::size_t{run.first} + run.count <= surfels.size(), "a run of surfels");
    std::fill_n(surfels.semantic_id.begin() + run.first, run.count, run.class_id);
    std::fill_n(surfels.instance_id.begin() + run.first, run.count, run.instance_id);
  }
  if (field == nullptr || edits.empty()) return;
  SEGSIM_CHECK(field->size() == surfels.size(), "a field of these surfels");
  FieldEditor editor(*field);
  editor.move(edits.moves);
  for (const LabelEdits::Run& run : edits.runs) editor.set(run);
}

void write_label_edits(const std::filesystem::path& file, const LabelEdits& edits,
                       std::size_t surfels) {
  internal::ByteWriter out;
  out.put(static_cast<std::uint32_t>(surfels));
  out.put(static_cast<std::uint32_t>(edits.runs.size()));
  out.put(static_cast<std::uint32_t>(edits.moves.size()));
  for (const LabelEdits::Run& run : edits.runs) {
    out.put(run.first);
    out.put(run.count);
    out.put(run.class_id);
    out.put(run.instance_id);
  }
  for (const LabelEdits::Move& move : edits.moves) {
    out.put(move.from);
    out.put(move.to);
  }
  internal::write_checked_file(file, kMagic, kVersion, out.bytes);
}

LabelEdits read_label_edits(const std::filesystem::path& file, std::size_t surfels) {
  const std::string place = file.string();
  const std::string payload =
      internal::read_checked_file(file, kMagic, "labels set by hand", kVersion).payload;
  internal::ByteReader in(payload, place);
  const auto of = in.take<std::uint32_t>();
  if (of != surfels) {
    throw core::InputError::expected(
        place, "labels of " + std::to_string(surfels) + " surfels", std::to_string(of));
  }
  const auto runs = in.take<std::uint32_t>();
  const auto moves = in.take<std::uint32_t>();
  LabelEdits edits;
  for (std::uint32_t i = 0; i < runs; ++i) {
    LabelEdits::Run run;
    run.first = in.take<std::uint32_t>();
    run.count = in.take<std::uint32_t>();
    run.class_id = in.take<std::uint16_t>();
    run.instance_id = in.take<std::uint16_t>();
    edits.runs.push_back(run);
  }
  for (std::uint32_t i = 0; i < moves; ++i) {
    LabelEdits::Move move;
    move.from = in.take<std::uint16_t>();
    move.to = in.take<std::uint16_t>();
    edits.moves.push_back(move);
  }
  in.expect_end();
  check_order(edits, surfels, place);
  return edits;
}

}  // namespace segsim::renderer

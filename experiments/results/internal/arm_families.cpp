#include "experiments/results/internal/arm_families.h"

#include <algorithm>
#include <set>
#include <utility>

#include "core/error.h"

namespace segsim::experiments::results::internal {
namespace {

/// An arm of the spec by its name; one row of an arm becomes a family of its own.
/// @throws core::InputError if there is neither.
void require_family(const std::vector<records::ArmRow>& arms, const std::string& name,
                    std::vector<Family>& families) {
  if (find_family(families, name) != nullptr) return;
  std::string names;
  for (std::size_t row = 0; row < arms.size(); ++row) {
    if (arms[row].name == name) {
      families.push_back({name, {row}});
      return;
    }
    names += (names.empty() ? "" : ", ") + arms[row].name;
  }
  throw core::InputError::expected("arm", "one of " + names, "\"" + name + "\"");
}

/// Rows of `family` in one reconstruction.
std::vector<std::size_t> rows_in(const std::vector<records::ArmRow>& arms,
                                 const Family& family, int reconstruction) {
  std::vector<std::size_t> rows;
  for (const std::size_t row : family.rows) {
    if (arms[row].reconstruction == reconstruction) rows.push_back(row);
  }
  return rows;
}

}  // namespace

std::vector<Family> arm_families(const std::vector<records::ArmRow>& arms) {
  std::vector<Family> families;
  for (std::size_t row = 0; row < arms.size(); ++row) {
    const auto known = std::find_if(families.begin(), families.end(), [&](const Family& f) {
      return f.name == records::family_of(arms[row]);
    });
    if (known != families.end()) {
      known->rows.push_back(row);
    } else {
      families.push_back({records::family_of(arms[row]), {row}});
    }
  }
  return families;
}

const Family* find_family(const std::vector<Family>& families, const std::string& name) {
  for (const Family& family : families) {
    if (family.name == name) return &family;
  }
  return nullptr;
}

std::vector<RowPair> paired_rows(const std::vector<records::ArmRow>& arms,
                                 const Family& before, const Family& after) {
  std::vector<RowPair> pairs;
  std::set<int> reconstructions;
  for (const std::size_t row : after.rows) reconstructions.insert(arms[row].reconstruction);
  for (const int r : reconstructions) {
    const std::vector<std::size_t> first = rows_in(arms, before, r);
    const std::vector<std::size_t> second = rows_in(arms, after, r);
    int training = 0;
    for (const std::size_t a : first) {
      for (const std::size_t b : second) {
        const bool same_seed = arms[a].finetune_seed == arms[b].finetune_seed;
        if (first.size() > 1 && second.size() > 1 && !same_seed) continue;
        pairs.push_back({a, b, r, training++});
      }
    }
  }
  if (!pairs.empty()) return pairs;
  throw core::InputError::expected("arms " + before.name + " and " + after.name,
                                   "trainings of the same reconstructions and seeds", "none");
}

void choose_arms(const std::string& before, const std::string& after,
                 std::vector<Family>& families, ResultTable& table) {
  std::vector<std::string> candidates;
  for (const Family& family : families) {
    if (table.arm_rows[family.rows.front()].detector == "oracle") {
      if (table.oracle.empty()) table.oracle = family.name;
    } else {
      candidates.push_back(family.name);
    }
  }
  const bool named =
      find_family(families, "before") != nullptr && find_family(families, "after") != nullptr;
  if (named) {
    table.before = "before";
    table.after = "after";
  } else if (candidates.size() >= 2) {
    table.before = candidates[0];
    table.after = candidates[1];
  }
  for (const auto& [name, chosen] :
       {std::pair(&before, &table.before), {&after, &table.after}}) {
    if (name->empty()) continue;
    require_family(table.arm_rows, *name, families);
    *chosen = *name;
  }
}

bool compares_weights(const std::vector<records::ArmRow>& arms,
                      const std::vector<RowPair>& pairs) {
  return std::any_of(pairs.begin(), pairs.end(), [&](const RowPair& pair) {
    const std::string& after = arms[pair.after].weights_sha256;
    return !after.empty() && after != arms[pair.before].weights_sha256;
  });
}

}  // namespace segsim::experiments::results::internal

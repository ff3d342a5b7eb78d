#include "renderer/scene/panoptic_field.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <string>

#include <glm/geometric.hpp>

#include "core/check.h"
#include "renderer/scene/parallel.h"

namespace segsim::renderer {
namespace {

constexpr std::size_t kMaxIds = 65535;
/// Excesses below this do not change a sum of doubles that matters.
constexpr double kNegligibleExcess = 1e-12;

template <std::size_t kSize>
bool all_finite(const std::array<float, kSize>& values) {
  return std::all_of(values.begin(), values.end(), [](float v) { return std::isfinite(v); });
}

template <std::size_t kSize>
double dot(const std::array<float, kSize>& a, const std::array<float, kSize>& b) {
  double sum = 0.0;
  for (std::size_t i = 0; i < kSize; ++i) {
    sum += static_cast<double>(a[i]) * static_cast<double>(b[i]);
  }
  return sum;
}

double sigmoid(double x) { return 1.0 / (1.0 + std::exp(-x)); }

/// Squared Mahalanobis distance of a point to a query.
class QueryShape {
 public:
  explicit QueryShape(const InstanceQuery& query)
      : centre_m_(query.position_m),
        R_query_world_(
            glm::transpose(glm::mat3_cast(glm::normalize(glm::dquat(query.R_world_query))))),
        inverse_sigma_(1.0 / glm::dvec3(query.sigma_m)) {}

  [[nodiscard]] double distance2(const glm::vec3& p_m) const {
    const glm::dvec3 local = R_query_world_ * (glm::dvec3(p_m) - centre_m_) * inverse_sigma_;
    return glm::dot(local, local);
  }

 private:
  glm::dvec3 centre_m_;
  glm::dmat3 R_query_world_;
  glm::dvec3 inverse_sigma_;
};

/// exp(A / tau) - 1 is negligible where A <= D < tau * kNegligibleExcess.
double reach2_of(const PanopticModel& model) {
  switch (model.variant) {
    case LabelVariant::kNormalised:
    case LabelVariant::kRaw:
      return kAttentionReach2;
    case LabelVariant::kLogSoftmax:
      return -2.0 * std::log(kNegligibleExcess);
    default:
      return -2.0 * std::log(std::min(1.0, static_cast<double>(model.temperature)) *
                             kNegligibleExcess);
  }
}

double temperature_of(const PanopticModel& model) {
  return model.variant == LabelVariant::kLiteral ? 1.0
                                                 : static_cast<double>(model.temperature);
}

std::vector<QueryShape> shapes_of(const PanopticModel& model) {
  return {model.queries.begin(), model.queries.end()};
}

void check_query(const InstanceQuery& query, std::size_t i) {
  const std::string name = "query " + std::to_string(i);
  const float norm = glm::dot(query.R_world_query, query.R_world_query);
  const glm::vec3& p = query.position_m;
  const glm::vec3& sigma = query.sigma_m;
  SEGSIM_CHECK(query.id > 0, name);
  SEGSIM_CHECK(std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z), name);
  SEGSIM_CHECK(std::abs(norm - 1.0F) < 1e-3F, name);
  SEGSIM_CHECK(sigma.x > 0.0F && sigma.y > 0.0F && sigma.z > 0.0F, name);
  SEGSIM_CHECK(std::isfinite(sigma.x) && std::isfinite(sigma.y) && std::isfinite(sigma.z),
               name);
  SEGSIM_CHECK(all_finite(query.feature), name);
}

using Entry = SparseScores::Entry;

/// Keeps the `capacity` largest of the entries, largest first, ties to the lower index.
void keep_largest(std::vector<Entry>& entries, std::size_t capacity) {
  const auto kept = static_cast<std::ptrdiff_t>(std::min(capacity, entries.size()));
  std::partial_sort(entries.begin(), entries.begin() + kept, entries.end(),
                    [](const Entry& a, const Entry& b) {
                      return a.excess > b.excess ||
                             (a.excess == b.excess && a.index < b.index);
                    });
  entries.resize(static_cast<std::size_t>(kept));
}

double sum_of(const std::vector<Entry>& entries) {
  double sum = 0.0;
  for (const Entry& entry : entries) sum += static_cast<double>(entry.excess);
  return sum;
}

/// A surfel's scores over queries, where they differ from a base common to all.
struct QueryScores {
  struct Score {
    std::uint16_t index;
    double excess;  ///< > 0.
    double share;   ///< Of the surfel's thing mass, in [0, 1]; sum <= 1.
  };
  std::vector<Score> scores;
  double base = 0.0;
  double threshold_scale = 1.0;  ///< min_excess applies to excess * this.
};

/// Folds one surfel after another.
class Folder {
 public:
  Folder(const SurfelCloud& surfels, const PanopticModel& model, const FoldOptions& options)
      : surfels_(surfels),
        model_(model),
        options_(options),
        shapes_(shapes_of(model)),
        reach2_(reach2_of(model)),
        temperature_(temperature_of(model)),
        class_of_query_(class_indices(model)) {}

  [[nodiscard]] bool queries_have_classes() const { return !class_of_query_.empty(); }

  /// @return  Mass that the row leaves out.
  double fold_classes(std::size_t i, const QueryScores& queries, SparseScores& scores) const {
    std::vector<double> p = class_probabilities(model_, surfels_.semantic_feature[i]);
    if (queries_have_classes()) give_things_to_queries(queries, p);
    std::vector<Entry> row;
    for (std::size_t c = 0; c < p.size(); ++c) {
      if (p[c] > 0.0 && p[c] >= static_cast<double>(options_.min_excess)) {
        row.push_back({static_cast<std::uint16_t>(c), static_cast<float>(p[c])});
      }
    }
    keep_largest(row, scores.row_capacity());
    scores.set(i, 0.0F, row);
    return p.empty() ? 0.0 : std::max(0.0, 1.0 - sum_of(row));
  }

  /// @return  Mass that the row leaves out.
  double fold_instances(std::size_t i, const QueryScores& queries,
                        SparseScores& scores) const {
    if (model_.queries.empty()) return 0.0;
    std::vector<Entry> row;
    double whole = 0.0;
    for (const auto& [index, excess, share] : queries.scores) {
      whole += excess;
      if (excess <= 0.0 ||
          excess * queries.threshold_scale < static_cast<double>(options_.min_excess)) {
        continue;
      }
      row.push_back({index, static_cast<float>(excess)});
    }
    keep_largest(row, scores.row_capacity());
    scores.set(i, static_cast<float>(queries.base), row);
    return std::max(0.0, whole - sum_of(row));
  }

  [[nodiscard]] QueryScores query_scores(std::size_t i) const {
    QueryScores result;
    if (model_.queries.empty()) return result;
    for (std::size_t q = 0; q < shapes_.size(); ++q) {
      const double distance2 = shapes_[q].distance2(surfels_.position_m[i]);
      if (distance2 > reach2_) continue;
      const double similarity =
          sigmoid(dot(model_.queries[q].feature, surfels_.instance_feature[i]));
      result.scores.push_back(
          {static_cast<std::uint16_t>(q), similarity * std::exp(-0.5 * distance2), 0.0});
    }
    if (has_none_score(model_.variant)) {
      normalise(result);
    } else {
      sharpen(result);
    }
    return result;
  }

 private:
  /// Empty if no query has a class; -1: has none.
  static std::vector<int> class_indices(const PanopticModel& model) {
    std::vector<int> result(model.queries.size(), -1);
    bool any = false;
    for (std::size_t q = 0; q < result.size(); ++q) {
      for (std::size_t c = 0; c < model.classes.size(); ++c) {
        if (model.queries[q].class_id == 0 || !model.classes[c].thing ||
            model.classes[c].id != model.queries[q].class_id) {
          continue;
        }
        result[q] = static_cast<int>(c);
        any = true;
      }
    }
    if (!any) result.clear();
    return result;
  }

  /// Softmax(A / tau) as its excess over 1/Z.
  void sharpen(QueryScores& result) const {
    double z = static_cast<double>(model_.queries.size());
    for (auto& s : result.scores) z += s.excess = std::expm1(s.excess / temperature_);
    result.base = 1.0 / z;
    for (auto& s : result.scores) {
      s.excess /= z;
      s.share = s.excess + result.base;
    }
    result.threshold_scale = z;
  }

  /// A / (sum A + none), or A for kRaw, and the none-score as a last entry.
  void normalise(QueryScores& result) const {
    const auto none = static_cast<double>(model_.none_score);
    const bool raw = model_.variant == LabelVariant::kRaw;
    double sum = raw ? 1e-6 : none;
    for (const auto& s : result.scores) sum += s.excess;
    for (auto& s : result.scores) {
      s.share = sum > 0.0 ? s.excess / sum : 0.0;
      if (!raw) s.excess = s.share;
    }
    if (none > 0.0) {
      result.scores.push_back(
          {static_cast<std::uint16_t>(model_.queries.size()), raw ? none : none / sum, 0.0});
    }
  }

  /// Moves the probability of things to the classes of the queries in proportion to their
  /// shares; what no query with a class claims stays.
  void give_things_to_queries(const QueryScores& queries, std::vector<double>& p) const {
    double things = 0.0, claimed = 0.0;
    for (std::size_t c = 0; c < p.size(); ++c) things += model_.classes[c].thing ? p[c] : 0.0;
    const auto class_of = [&](std::uint16_t query) {
      return query < class_of_query_.size() ? class_of_query_[query] : -1;
    };
    for (const auto& s : queries.scores) claimed += class_of(s.index) >= 0 ? s.share : 0.0;
    for (std::size_t c = 0; c < p.size(); ++c) {
      if (model_.classes[c].thing) p[c] *= std::max(0.0, 1.0 - claimed);
    }
    for (const auto& s : queries.scores) {
      if (class_of(s.index) < 0) continue;
      p[static_cast<std::size_t>(class_of(s.index))] += things * s.share;
    }
  }

  const SurfelCloud& surfels_;
  const PanopticModel& model_;
  const FoldOptions& options_;
  std::vector<QueryShape> shapes_;
  double reach2_, temperature_;
  std::vector<int> class_of_query_;
};

DroppedMass summary_of(const std::vector<double>& dropped) {
  DroppedMass mass;
  for (const double d : dropped) {
    mass.mean += d;
    mass.max = std::max(mass.max, d);
  }
  if (!dropped.empty()) mass.mean /= static_cast<double>(dropped.size());
  return mass;
}

}  // namespace

void check_panoptic_model(const PanopticModel& model) {
  SEGSIM_CHECK(model.temperature > 0.0F && std::isfinite(model.temperature),
               "temperature = " + std::to_string(model.temperature));
  SEGSIM_CHECK(model.none_score >= 0.0F && std::isfinite(model.none_score),
               "none_score = " + std::to_string(model.none_score));
  SEGSIM_CHECK(model.variant <= LabelVariant::kLiteral, "label variant");
  SEGSIM_CHECK(model.classes.size() <= kMaxIds, "number of classes");
  SEGSIM_CHECK(model.queries.size() < kMaxIds, "number of queries");
  std::set<std::uint16_t> ids;
  for (const PanopticClass& c : model.classes) {
    const std::string name = "class " + std::to_string(c.id);
    SEGSIM_CHECK(ids.insert(c.id).second, name);
    SEGSIM_CHECK(all_finite(c.weight) && std::isfinite(c.bias), name);
  }
  const auto is_thing = [&](std::uint16_t id) {
    return std::any_of(model.classes.begin(), model.classes.end(),
                       [id](const PanopticClass& c) { return c.id == id && c.thing; });
  };
  ids.clear();
  for (std::size_t i = 0; i < model.queries.size(); ++i) {
    check_query(model.queries[i], i);
    SEGSIM_CHECK(ids.insert(model.queries[i].id).second, "query " + std::to_string(i));
    SEGSIM_CHECK(model.queries[i].class_id == 0 || is_thing(model.queries[i].class_id),
                 "class of query " + std::to_string(i));
  }
}

std::vector<double> class_probabilities(const PanopticModel& model,
                                        const core::SemanticFeature& feature) {
  std::vector<double> p(model.classes.size());
  if (p.empty()) return p;
  for (std::size_t c = 0; c < p.size(); ++c) {
    p[c] = dot(model.classes[c].weight, feature) + static_cast<double>(model.classes[c].bias);
  }
  const double largest = *std::max_element(p.begin(), p.end());
  double sum = 0.0;
  for (double& value : p) sum += value = std::exp(value - largest);
  for (double& value : p) value /= sum;
  return p;
}

std::vector<double> attention(const PanopticModel& model, const glm::vec3& position_m,
                              const core::InstanceFeature& feature) {
  std::vector<double> a(model.queries.size());
  for (std::size_t q = 0; q < a.size(); ++q) {
    const double distance2 = QueryShape(model.queries[q]).distance2(position_m);
    a[q] = sigmoid(dot(model.queries[q].feature, feature)) * std::exp(-0.5 * distance2);
  }
  return a;
}

SparseScores::SparseScores(std::size_t surfels, std::size_t row_capacity)
    : row_capacity_(row_capacity),
      base_(surfels, 0.0F),
      count_(surfels, 0),
      entries_(surfels * row_capacity, Entry{0, 0.0F}) {}

std::size_t SparseScores::bytes() const {
  return base_.size() * sizeof(float) + count_.size() * sizeof(std::uint16_t) +
         entries_.size() * sizeof(Entry);
}

void SparseScores::set(std::size_t surfel, float base, std::span<const Entry> row) {
  SEGSIM_CHECK(row.size() <= row_capacity_, std::to_string(row.size()));
  base_[surfel] = base;
  count_[surfel] = static_cast<std::uint16_t>(row.size());
  std::copy(row.begin(), row.end(),
            entries_.begin() + static_cast<std::ptrdiff_t>(surfel * row_capacity_));
}

PanopticField fold_panoptic_model(const SurfelCloud& surfels, const PanopticModel& model,
                                  const FoldOptions& options) {
  check_surfels(surfels);
  check_panoptic_model(model);
  SEGSIM_CHECK(surfels.has_features() || surfels.size() == 0, "a cloud without features");
  SEGSIM_CHECK(options.max_classes >= 1 && options.max_instances >= 1, "entries of a row");
  SEGSIM_CHECK(options.min_excess >= 0.0F, std::to_string(options.min_excess));
  PanopticField field;
  for (const PanopticClass& c : model.classes) {
    field.class_id.push_back(c.id);
    field.class_is_thing.push_back(c.thing ? 1 : 0);
  }
  const Folder folder(surfels, model, options);
  for (const InstanceQuery& q : model.queries) field.instance_id.push_back(q.id);
  const bool none = has_none_score(model.variant) && !model.queries.empty();
  if (none) field.instance_id.push_back(0);
  if (folder.queries_have_classes()) {
    for (const InstanceQuery& q : model.queries) field.instance_class.push_back(q.class_id);
    if (none) field.instance_class.push_back(0);
  }
  const std::size_t n = surfels.size();
  const auto capacity = [](int wanted, std::size_t there) {
    return std::min(static_cast<std::size_t>(wanted), there);
  };
  field.classes = SparseScores(n, capacity(options.max_classes, model.classes.size()));
  field.instances = SparseScores(n, capacity(options.max_instances, field.instance_id.size()));

  std::vector<double> dropped_classes(n), dropped_instances(n);
  constexpr std::size_t kPerTask = 1024;
  internal::Workers workers(options.threads);
  workers.for_each((n + kPerTask - 1) / kPerTask, [&](std::size_t task) {
    const std::size_t end = std::min(n, (task + 1) * kPerTask);
    for (std::size_t i = task * kPerTask; i < end; ++i) {
      const QueryScores queries = folder.query_scores(i);
      dropped_classes[i] = folder.fold_classes(i, queries, field.classes);
      dropped_instances[i] = folder.fold_instances(i, queries, field.instances);
    }
  });
  field.dropped_classes = summary_of(dropped_classes);
  field.dropped_instances = summary_of(dropped_instances);
  return field;
}

}  // namespace segsim::renderer

#include "nav/policies/built_in_policies.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <utility>

#include "core/error.h"
#include "nav/behaviours/fitted_options.h"
#include "nav/frontier/frontier_policy.h"
#include "nav/frontier/value_search.h"
#include "nav/policies/internal/semantic_prior_data.h"

namespace segsim::nav {
namespace {

using core::ConfigNode;
using core::one_of;

constexpr int kMostRepeats = 10'000;

Rule read_rule(const ConfigNode& node) {
  return one_of(node, node.as_text(), {"vlfm", "fixed"}) == 0 ? Rule::kVlfm : Rule::kFixed;
}

/// "forward", "left*12", ...
void read_action(const ConfigNode& node, std::vector<DiscreteAction>& actions) {
  const std::string text = node.as_text();
  const std::size_t star = text.find('*');
  int count = 1;
  if (star != std::string::npos) {
    const char* end = text.data() + text.size();
    const auto [stopped, error] = std::from_chars(text.data() + star + 1, end, count);
    if (error != std::errc() || stopped != end || count < 1 || count > kMostRepeats) {
      node.fail("a count in [1, " + std::to_string(kMostRepeats) + "] after *",
                "\"" + text + "\"");
    }
  }
  const auto action = static_cast<DiscreteAction>(
      one_of(node, text.substr(0, star), {"stop", "forward", "left", "right"}));
  actions.insert(actions.end(), static_cast<std::size_t>(count), action);
}

/// A number of a map in [low, 1]; `low` itself only if it is included.
double share_or(const ConfigNode& node, const std::string& key, double fallback,
                bool with_zero) {
  const double value = node.number_or(key, fallback);
  if (!(value <= 1.0 && (with_zero ? value >= 0.0 : value > 0.0))) {
    node.child(key).fail(with_zero ? "a number in [0, 1]" : "a number in (0, 1]",
                         node.text(key));
  }
  return value;
}

void read_frontier(const SettingsNode& node, FrontierSettings& settings) {
  if (node.has("follower")) {
    settings.dynamic_window = choice(node, "follower", {"pure-pursuit", "dwa"}) == 1;
  }
  settings.rival_iou = share_or(node, "rival_iou", settings.rival_iou, false);
}

/// A path that must be that of a file, before any trial.
std::filesystem::path file_of(const SettingsNode& node, const std::string& key) {
  std::filesystem::path file = node.path(key);
  if (!std::filesystem::is_regular_file(file)) {
    node.child(key).fail("the description of a model (docs/models.md)",
                         "no file " + file.string());
  }
  return file;
}

void read_scorer_model(const SettingsNode& node, ScorerSettings& settings) {
  settings.type = "model";
  settings.model = file_of(node, "model");
  settings.prompt = node.text_or("prompt", settings.prompt);
  if (settings.prompt.find("{}") == std::string::npos) {
    node.child("prompt").fail("a text with {} where the target stands", settings.prompt);
  }
  node.finish();
}

void read_scorer(const SettingsNode& node, ScorerSettings& settings) {
  if (node.has("scorer") && !node.child("scorer").is_scalar()) {
    read_scorer_model(node.map("scorer"), settings);
    if (node.has("prior")) node.child("prior").fail("no prior beside a model", "both");
    return;
  }
  if (node.has("scorer")) {
    settings.type = node.text("scorer");
    (void)one_of(node.child("scorer"), settings.type,
                 {"semantic-prior", "constant", "open-space"});
  }
  if (node.has("prior")) {
    settings.prior = node.path("prior");
    (void)SemanticPrior::load(settings.prior);  // A mistake is reported before any trial.
  }
}

void read_frontier_value(const SettingsNode& node, FrontierValueSettings& settings) {
  read_frontier(node, settings.search);
  read_scorer(node, settings.scorer);
}

void read_random(const SettingsNode& node, RandomSettings& settings) {
  settings.stop_chance = share_or(node, "stop_chance", settings.stop_chance, true);
}

void read_script(const SettingsNode& node, ScriptSettings& settings) {
  for (const ConfigNode& action : node.child("actions").as_list()) {
    read_action(action, settings.actions);
  }
}

void read_vlfm(const SettingsNode& node, VlfmSettings& settings) {
  if (node.has("parity")) {
    const Rule rule = read_rule(node.child("parity"));
    settings.rules = VlfmRules(rule);
    settings.second_look = settings.approach = settings.sweep = rule == Rule::kFixed;
  }
  if (const auto quirks = node.optional_child("quirks")) {
    for (std::size_t k = 0; k < kQuirks; ++k) {
      if (quirks->has(quirk_names()[k])) {
        settings.rules.set(static_cast<Quirk>(k), read_rule(quirks->child(quirk_names()[k])));
      }
    }
    quirks->finish();
  }
  if (node.has("motion")) {
    const std::size_t motion = choice(node, "motion", {"discrete", "pursuit"});
    settings.motion = motion == 0 ? Motion::kDiscrete : Motion::kPursuit;
  }
  if (node.has("follower")) {
    if (node.has("motion")) node.child("motion").fail("no motion beside follower", "both");
    const std::size_t follower = choice(node, "follower", {"discrete", "pure-pursuit", "dwa"});
    settings.motion = follower == 0 ? Motion::kDiscrete : Motion::kPursuit;
    settings.dynamic_window = follower == 2;
  }
  if (node.has("planner")) {
    settings.planner =
        static_cast<GridPlanner>(choice(node, "planner", {"astar", "fast-marching"}));
  }
  settings.second_look = node.boolean_or("second_look", settings.second_look);
  settings.approach = node.boolean_or("approach", settings.approach);
  settings.sweep = node.boolean_or("sweep", settings.sweep);
  settings.clean_cloud = node.boolean_or("clean_cloud", settings.clean_cloud);
  settings.give_up_s = node.number_or("give_up_s", settings.give_up_s);
  if (!(settings.give_up_s >= 0.0 && std::isfinite(settings.give_up_s))) {
    node.child("give_up_s").fail("seconds, 0 (never) or more", node.text("give_up_s"));
  }
  // Both are part of another rule: without it the key would do nothing.
  if (node.has("clean_cloud") && settings.clean_cloud && !settings.approach) {
    node.child("clean_cloud").fail("false, or approach: true", "true without approach");
  }
  if (node.has("give_up_s") && settings.give_up_s > 0.0 && !settings.sweep) {
    node.child("give_up_s").fail("0, or sweep: true", node.text("give_up_s"));
  }
  settings.min_score = share_or(node, "min_score", settings.min_score, true);
  if (node.has("fusion")) {
    settings.fusion = static_cast<FusionRule>(
        choice(node, "fusion", {"weighted", "max-confidence", "replace", "equal-weighting"}));
  }
  read_scorer(node, settings.scorer);
  if (node.has("segmenter")) settings.segmenter = file_of(node, "segmenter");
  if (node.has("inferred_depth")) settings.depth = file_of(node, "inferred_depth");
}

/// Of what the context hands in. @throws core::InputError if it is nothing.
template <class Load, class... Arguments>
auto load_model(const Load& load, const std::filesystem::path& model,
                Arguments&&... arguments) {
  if (load == nullptr) {
    throw core::InputError::expected(model.string(), "a policy that can use models here",
                                     "one that cannot");
  }
  return load(model, std::forward<Arguments>(arguments)...);
}

std::shared_ptr<ImageTextScorer> make_scorer(const ScorerSettings& settings,
                                             const PolicyContext& context) {
  if (settings.type == "constant") return make_constant_scorer();
  if (settings.type == "open-space") return make_open_space_scorer();
  if (settings.type == "model") {
    return load_model(context.models.scorer, settings.model, settings.prompt);
  }
  const SemanticPrior& prior = default_semantic_prior();
  return make_semantic_scorer(
      settings.prior.empty() ? prior : SemanticPrior::load(settings.prior),
      context.class_names);
}

FrontierPolicyOptions frontier_options(const FrontierSettings& settings,
                                       const PolicyContext& context) {
  FrontierPolicyOptions options = frontier_for(context.robot);
  options.objects.rival_iou = settings.rival_iou;
  if (settings.dynamic_window) options.follower.motion = LocalMotion::kDynamicWindow;
  return options;
}

std::unique_ptr<core::Policy> make_frontier(const FrontierSettings& settings,
                                            const PolicyContext& context) {
  return make_frontier_policy(frontier_options(settings, context));
}

std::unique_ptr<core::Policy> make_frontier_value(const FrontierValueSettings& settings,
                                                  const PolicyContext& context) {
  ValueSearchOptions options;
  options.frontier = frontier_options(settings.search, context);
  options.values.min_depth_m = 0.1;
  options.values.band_max_m = context.camera_height_m + 0.1;
  options.scorer = make_scorer(settings.scorer, context);
  return make_value_search(options);
}

std::unique_ptr<core::Policy> make_vlfm(const VlfmSettings& settings,
                                        const PolicyContext& context) {
  VlfmOptions options = vlfm_for(context.robot, settings.rules, context.camera_height_m);
  options.motion = settings.motion;
  options.second_look = settings.second_look;
  options.approach = options.approach && settings.approach;
  if (!settings.sweep) options.sweep.most_places = 0;
  if (!settings.clean_cloud) {
    options.approach_floor_m = options.approach_carve_m = options.approach_support_share = 0.0;
  }
  options.give_up_s =
      settings.give_up_s > 0.0 ? settings.give_up_s : std::numeric_limits<double>::infinity();
  options.min_score = settings.min_score;
  options.values.fusion = settings.fusion;
  if (settings.dynamic_window) options.follower.motion = LocalMotion::kDynamicWindow;
  options.scorer = make_scorer(settings.scorer, context);
  if (!settings.segmenter.empty()) {
    options.segmenter = load_model(context.models.segmenter, settings.segmenter);
  }
  if (!settings.depth.empty()) {
    options.depth = load_model(context.models.depth, settings.depth);
  }
  GridLocalOptions local;
  local.planner = settings.planner;
  local.actions = options.actions;
  options.local = make_grid_local_policy(local);
  return make_vlfm_policy(options);
}

std::unique_ptr<core::Policy> make_oracle_path(const PolicyContext& context) {
  OraclePathOptions options;
  options.follower = fitted(options.follower, context.robot);
  options.back_mps = std::min(options.back_mps, context.robot.max_forward_mps);
  return make_oracle_path_policy(context.oracle, options);
}

std::unique_ptr<core::Policy> make_random(const RandomSettings& settings,
                                          const PolicyContext& context) {
  RandomPolicyOptions options;
  options.actions = fitted(options.actions, context.robot);
  options.stop_chance = settings.stop_chance;
  return make_random_policy(options);
}

std::unique_ptr<core::Policy> make_script(const ScriptSettings& settings,
                                          const PolicyContext& context) {
  return make_script_policy(settings.actions, fitted(DiscreteMotionOptions{}, context.robot));
}

void read_process(const SettingsNode& node, ProcessSettings& settings) {
  settings.peer = core::read_peer_command(
      node, [&](const ConfigNode& path) { return node.expanded(path); });
}

std::unique_ptr<core::Policy> make_process(const ProcessSettings& settings,
                                           const PolicyContext& context) {
  if (!context.models.process) {
    throw core::InputError::expected(settings.peer.in_words(),
                                     "a policy of this program: no other can be started here",
                                     "a process");
  }
  return context.models.process(settings.peer, context);
}

constexpr int kHighestDomain = 232;

double seconds_or(const SettingsNode& node, const std::string& key, double fallback_s) {
  const double value_s = node.number_or(key, fallback_s);
  if (!(value_s > 0.0 && value_s <= 3600.0)) {
    node.child(key).fail("seconds in (0, 3600]", node.text(key));
  }
  return value_s;
}

void read_ros2(const SettingsNode& node, Ros2Settings& settings) {
  const double domain = node.number_or("domain", 0.0);
  if (!(domain >= 0.0 && domain <= kHighestDomain && domain == std::floor(domain))) {
    node.child("domain").fail("a whole number in [0, " + std::to_string(kHighestDomain) + "]",
                              node.text("domain"));
  }
  settings.domain = static_cast<int>(domain);
  if (node.has("distro")) settings.humble = choice(node, "distro", {"humble", "jazzy"}) == 0;
  if (node.has("cmd_vel"))
    settings.stamped = choice(node, "cmd_vel", {"twist", "twist_stamped"}) == 1;
  if (node.has("commands")) settings.waits = choice(node, "commands", {"each", "newest"}) == 0;
  settings.answer_s = seconds_or(node, "answer_s", settings.answer_s);
  settings.start_s = seconds_or(node, "start_s", settings.start_s);
  settings.detections = node.boolean_or("detections", settings.detections);
  if (node.has("depth")) settings.depth_mm = choice(node, "depth", {"32fc1", "16uc1"}) == 1;
  settings.truth = node.boolean_or("truth", settings.truth);
  settings.map = node.boolean_or("map", settings.map);
  if (node.has("dds")) settings.fast_dds = choice(node, "dds", {"cyclone", "fast"}) == 1;
  settings.config = node.text_or("config", settings.config);
}

std::unique_ptr<core::Policy> make_ros2(const Ros2Settings& settings,
                                        const PolicyContext& context) {
  if (!context.models.ros2) {
    throw core::InputError::expected("policy ros2",
                                     "a policy of this program: none can be reached here",
                                     "a stack on a network");
  }
  return context.models.ros2(settings, context);
}

}  // namespace

const SemanticPrior& default_semantic_prior() {
  static const SemanticPrior prior = SemanticPrior::parse(
      internal::kSemanticPriorYaml, "nav/policies/data/semantic_prior.yaml");
  return prior;
}

void add_built_in_policies(PolicyRegistry& registry) {
  for (const char* name : {"frontier", "frontier-nearest"}) {
    registry.add<FrontierSettings>(name, read_frontier, make_frontier);
  }
  registry.add<FrontierValueSettings>("frontier-value", read_frontier_value,
                                      make_frontier_value);
  registry.add<VlfmSettings>("vlfm", read_vlfm, make_vlfm);
  registry.add("oracle-path", make_oracle_path);
  registry.add<RandomSettings>("random", read_random, make_random);
  registry.add<ScriptSettings>("script", read_script, make_script, "actions: [...]");
  registry.add<ProcessSettings>("process", read_process, make_process, "command: [...]");
  registry.add<Ros2Settings>("ros2", read_ros2, make_ros2);
}

}  // namespace segsim::nav

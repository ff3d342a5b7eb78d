#include "python/native/environments/environment_batch.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include "core/error.h"
#include "experiments/episodes/episode_check.h"
#include "python/native/environments/action_arrays.h"
#include "python/native/owned_array.h"
#include "renderer/cpu_renderer.h"
#include "renderer/files/scene_surfels.h"

namespace segsim::python {
namespace {

namespace nb = nanobind;
using namespace nb::literals;
namespace episodes = experiments::episodes;

/// Classes of which the scene has things.
std::vector<std::string> classes_of_things(const core::SceneManifest& manifest) {
  std::vector<std::string> names;
  for (const core::SceneClass& c : manifest.classes) {
    const bool there = std::any_of(
        manifest.instances.begin(), manifest.instances.end(),
        [&](const core::SceneInstance& instance) { return instance.class_id == c.id; });
    if (c.thing && there) names.push_back(c.name);
  }
  return names;
}

std::vector<std::string> drawn_images(const EnvironmentSettings& settings) {
  std::vector<std::string> names;
  for (const std::string& name : settings.images) {
    if (name != "depth") names.push_back(name);
  }
  return names;
}

}  // namespace

ObservationArrays::ObservationArrays(const EnvironmentSettings& settings, std::size_t count)
    : count_(count),
      width_px_(settings.size.first),
      height_px_(settings.size.second),
      choice_(drawn_images(settings)),
      images_(choice_, count, width_px_, height_px_),
      with_depth_(std::find(settings.images.begin(), settings.images.end(), "depth") !=
                  settings.images.end()),
      pose_(3 * count),
      goal_(count) {
  const std::size_t pixels =
      static_cast<std::size_t>(width_px_) * static_cast<std::size_t>(height_px_);
  if (with_depth_) depth_m_ = std::make_unique_for_overwrite<float[]>(count * pixels);
}

void ObservationArrays::put(std::size_t index, const sim::ObjectNavEnvironment& environment,
                            std::int64_t goal) {
  images_.put(index, environment.frame());
  if (with_depth_) {
    const std::vector<float>& from = environment.depth_m().pixels();
    float* to = depth_m_.get() + index * from.size();
    // NaN would lie outside of every space of numbers.
    std::transform(from.begin(), from.end(), to, [](float z) { return z > 0.0F ? z : 0.0F; });
  }
  const core::Pose2 pose = environment.pose_since_start();
  pose_[3 * index] = static_cast<float>(pose.x_m);
  pose_[3 * index + 1] = static_cast<float>(pose.y_m);
  pose_[3 * index + 2] = static_cast<float>(pose.yaw_rad);
  goal_[index] = goal;
}

nb::dict ObservationArrays::take() {
  nb::dict arrays = images_.take();
  if (with_depth_) {
    auto memory = std::make_unique<std::unique_ptr<float[]>>(std::move(depth_m_));
    float* data = memory->get();
    arrays["depth"] = array_over(
        data, std::move(memory),
        {count_, static_cast<std::size_t>(height_px_), static_cast<std::size_t>(width_px_)});
  }
  arrays["pose"] = owned_array(std::move(pose_), {count_, 3});
  arrays["goal"] = owned_array(std::move(goal_), {count_});
  return arrays;
}

InformationArrays::InformationArrays(std::size_t count)
    : count_(count),
      success_(count),
      collided_(count),
      spl_(count),
      soft_spl_(count),
      distance_m_(count),
      path_m_(count),
      shortest_path_m_(count),
      time_s_(count),
      pose_(3 * count),
      collisions_(count),
      episode_(count),
      outcome_(count) {}

void InformationArrays::put(std::size_t i, const sim::ObjectNavEnvironment& environment,
                            std::size_t episode) {
  const sim::TrialResult result = environment.result();
  success_[i] = result.success ? 1 : 0;
  spl_[i] = result.spl;
  soft_spl_[i] = result.soft_spl;
  distance_m_[i] = result.distance_to_goal_m;
  path_m_[i] = result.path_m;
  shortest_path_m_[i] = result.shortest_path_m;
  time_s_[i] = result.sim_s;
  pose_[3 * i] = result.final_pose.x_m;
  pose_[3 * i + 1] = result.final_pose.y_m;
  pose_[3 * i + 2] = result.final_pose.yaw_rad;
  collisions_[i] = result.contacts;
  episode_[i] = static_cast<std::int64_t>(episode);
  outcome_[i] = environment.over() ? static_cast<std::int64_t>(result.outcome) : -1;
}

void InformationArrays::put_collided(std::span<const sim::VectorEnvironment::Step> steps) {
  for (std::size_t i = 0; i < count_; ++i) collided_[i] = steps[i].step.collided ? 1 : 0;
}

nb::dict InformationArrays::take() {
  nb::dict info;
  const std::vector<std::size_t> shape{count_};
  info["success"] = owned_array<bool>(std::move(success_), shape);
  info["spl"] = owned_array(std::move(spl_), shape);
  info["soft_spl"] = owned_array(std::move(soft_spl_), shape);
  info["collisions"] = owned_array(std::move(collisions_), shape);
  info["collided"] = owned_array<bool>(std::move(collided_), shape);
  info["distance_m"] = owned_array(std::move(distance_m_), shape);
  info["path_m"] = owned_array(std::move(path_m_), shape);
  info["shortest_path_m"] = owned_array(std::move(shortest_path_m_), shape);
  info["time_s"] = owned_array(std::move(time_s_), shape);
  info["true_pose"] = owned_array(std::move(pose_), {count_, 3});
  info["episode_number"] = owned_array(std::move(episode_), shape);
  info["outcome"] = owned_array(std::move(outcome_), shape);
  return info;
}

EnvironmentBatch::EnvironmentBatch(const std::filesystem::path& scene,
                                   const std::optional<std::filesystem::path>& file,
                                   const EnvironmentSettings& settings, int count, int threads)
    : settings_(settings) {
  check_settings(settings);
  const auto positive = [](const char* name, int value) {
    if (value >= 1 && value <= 4096) return;
    throw core::InputError::expected(name, "1 to 4096", std::to_string(value));
  };
  positive("num_envs", count);
  positive("threads", threads);
  const sim::RobotModel robot = sim::RobotModel::by_name(settings.robot);
  bundle_ = core::load_bundle(scene);
  world_ = std::make_unique<const sim::World>(sim::World::load(bundle_, robot));
  const renderer::SceneSurfels content = renderer::load_scene_surfels(bundle_);
  if (!content.surfels->has_labels()) {
    throw core::InputError::expected(bundle_.surfels_file().string(), "labelled surfels",
                                     "none");
  }
  const sim::EnvironmentOptions options = environment_options(settings, robot);
  const auto make_renderer = [&](int renderer_threads) {
    renderer::RenderOptions drawing;
    drawing.threads = renderer_threads;
    return renderer::make_cpu_renderer(content.surfels, drawing, content.labels);
  };
  if (file) {
    bind(episodes::read_episodes(*file), file->string());
  } else {
    const auto goals =
        settings.goals.empty() ? classes_of_things(bundle_.manifest) : settings.goals;
    bind(episodes::generate_episodes(bundle_.manifest.name, bundle_, *world_,
                                     *make_renderer(threads),
                                     episode_rules(settings, options, goals)),
         scene.string());
  }
  discrete_ = std::make_unique<const sim::DiscreteActions>(
      robot, settings.control_period_s, options.trial.substep_s,
      sim::DiscreteSteps{settings.forward_step_m, settings.turn_step_rad});
  environments_ = std::make_unique<sim::VectorEnvironment>(
      *pool_, options, sim::VectorEnvironment::Size{static_cast<std::size_t>(count), threads},
      order_of(settings), make_renderer);
}

void EnvironmentBatch::bind(episodes::EpisodeSet set, const std::string& place) {
  const std::vector<episodes::EpisodeFinding> findings =
      episodes::bind_episodes(set, place, bundle_, *world_);
  std::vector<sim::Episode> feasible;
  for (std::size_t i = 0; i < findings.size(); ++i) {
    const std::vector<std::string>& goals = settings_.goals;
    const bool wanted = goals.empty() || std::find(goals.begin(), goals.end(),
                                                   set.episodes[i].class_name) != goals.end();
    infeasible_ += wanted && findings[i].infeasible() ? 1 : 0;
    if (wanted && !findings[i].infeasible()) feasible.push_back(std::move(set.episodes[i]));
  }
  if (feasible.empty()) {
    throw core::InputError::expected(place, "an episode that " + robot().name + " can do",
                                     "none of " + std::to_string(findings.size()));
  }
  goal_classes_ = settings_.goal_classes.empty() ? settings_.goals : settings_.goal_classes;
  if (goal_classes_.empty()) goal_classes_ = classes_of_things(bundle_.manifest);
  for (const sim::Episode& episode : feasible) {
    const auto found =
        std::find(goal_classes_.begin(), goal_classes_.end(), episode.class_name);
    if (found == goal_classes_.end()) {
      throw core::InputError::expected("goal_classes", "the class of every goal",
                                       "no " + episode.class_name);
    }
    goal_of_.push_back(found - goal_classes_.begin());
  }
  pool_ = std::make_unique<const sim::EpisodePool>(*world_, std::move(feasible));
}

std::vector<std::string> EnvironmentBatch::episode_ids() const {
  std::vector<std::string> ids;
  for (std::size_t i = 0; i < pool_->size(); ++i) ids.push_back(pool_->episode(i).id);
  return ids;
}

std::vector<int> EnvironmentBatch::goal_class_ids() const {
  std::vector<int> ids;
  for (const std::string& name : goal_classes_) {
    const core::SceneClass* found = bundle_.manifest.find_class(name);
    ids.push_back(found != nullptr ? found->id : 0);
  }
  return ids;
}

std::vector<std::pair<double, double>> EnvironmentBatch::commands(int action) const {
  if (action < 0 || action >= sim::kDiscreteActions) {
    throw core::InputError::expected("action", "0 to 3", std::to_string(action));
  }
  std::vector<std::pair<double, double>> pairs;
  for (const core::VelocityCommand& command :
       discrete_->commands(static_cast<sim::DiscreteAction>(action))) {
    pairs.emplace_back(command.forward_mps, command.turn_radps);
  }
  return pairs;
}

void EnvironmentBatch::put(std::size_t index, const sim::ObjectNavEnvironment& environment,
                           ObservationArrays& seen, InformationArrays& known) const {
  const std::size_t episode = environments_->episode(index);
  seen.put(index, environment, goal_of_[episode]);
  known.put(index, environment, episode);
}

nb::tuple EnvironmentBatch::reset(const std::vector<std::optional<std::uint64_t>>& seeds,
                                  const std::vector<std::int64_t>& wanted) {
  const std::size_t count = environments_->size();
  if (seeds.size() != count || wanted.size() != count) {
    throw core::InputError::expected(
        "seeds and episodes", std::to_string(count) + " of each",
        std::to_string(seeds.size()) + " and " + std::to_string(wanted.size()));
  }
  std::vector<sim::VectorEnvironment::Reset> resets;
  for (std::size_t i = 0; i < count; ++i) {
    if (wanted[i] < -1 || wanted[i] >= static_cast<std::int64_t>(pool_->size())) {
      throw core::InputError::expected("episode", "0 to " + std::to_string(pool_->size() - 1),
                                       std::to_string(wanted[i]));
    }
    resets.push_back({seeds[i].has_value(), seeds[i].value_or(0), wanted[i]});
  }
  ObservationArrays seen(settings_, count);
  InformationArrays known(count);
  {
    const nb::gil_scoped_release released;
    const std::lock_guard lock(mutex_);
    environments_->reset(resets, [&](std::size_t i, const sim::ObjectNavEnvironment& one) {
      put(i, one, seen, known);
    });
    begun_ = true;
  }
  return nb::make_tuple(seen.take(), known.take());
}

nb::tuple EnvironmentBatch::step(nb::handle actions) {
  const std::size_t count = environments_->size();
  if (!begun_) throw core::InputError("step: reset() must be called first");
  const ActionArrays decoded(
      actions, settings_.action == "discrete" ? discrete_.get() : nullptr, count);
  ObservationArrays seen(settings_, count);
  InformationArrays known(count);
  std::vector<sim::VectorEnvironment::Step> steps;
  {
    const nb::gil_scoped_release released;
    const std::lock_guard lock(mutex_);
    steps = environments_->step(decoded.actions(),
                                [&](std::size_t i, const sim::ObjectNavEnvironment& one) {
                                  put(i, one, seen, known);
                                });
  }
  known.put_collided(steps);
  std::vector<double> rewards;
  std::vector<std::uint8_t> terminated, truncated;
  for (const sim::VectorEnvironment::Step& step : steps) {
    rewards.push_back(step.step.reward);
    terminated.push_back(step.step.terminated ? 1 : 0);
    truncated.push_back(step.step.truncated ? 1 : 0);
  }
  return nb::make_tuple(seen.take(), owned_array(std::move(rewards), {count}),
                        owned_array<bool>(std::move(terminated), {count}),
                        owned_array<bool>(std::move(truncated), {count}), known.take());
}

void bind_environment_batch(nb::module_& module) {
  nb::class_<EnvironmentBatch>(module, "EnvironmentBatch",
                               "Environments of one scene that are stepped together.")
      .def(nb::init<const std::filesystem::path&, const std::optional<std::filesystem::path>&,
                    const EnvironmentSettings&, int, int>(),
           "scene"_a, "episodes"_a.none(), "settings"_a, "count"_a, "threads"_a,
           nb::call_guard<nb::gil_scoped_release>(),
           "Load a bundle and a set of episodes, or make episodes. Raises InputError.")
      .def("reset", &EnvironmentBatch::reset, "seeds"_a, "episodes"_a,
           nb::sig("def reset(self, seeds: collections.abc.Sequence[int | None], episodes: "
                   "collections.abc.Sequence[int]) -> tuple[dict[str, "
                   "numpy.typing.NDArray[typing.Any]], dict[str, "
                   "numpy.typing.NDArray[typing.Any]]]"),
           "Begin an episode in every environment: observations and information. A seed of "
           "None goes on in the order of episodes, an episode of -1 is the next one.")
      .def("step", &EnvironmentBatch::step, "actions"_a,
           nb::sig("def step(self, actions: numpy.typing.ArrayLike) -> tuple[dict[str, "
                   "numpy.typing.NDArray[typing.Any]], numpy.typing.NDArray[numpy.float64], "
                   "numpy.typing.NDArray[numpy.bool_], numpy.typing.NDArray[numpy.bool_], "
                   "dict[str, numpy.typing.NDArray[typing.Any]]]"),
           "One step in every environment: observations, rewards, terminated, truncated, "
           "information. Where an episode is over, the next one begins, whatever the action. "
           "Other threads of Python run meanwhile.")
      .def("commands", &EnvironmentBatch::commands, "action"_a,
           "What a discrete action is: forward and turning speed for each control period.")
      .def_prop_ro("goal_class_ids", &EnvironmentBatch::goal_class_ids,
                   "Their ids in semantic images; 0 for a class that the scene lacks.")
      .def_prop_ro("goal_classes", &EnvironmentBatch::goal_classes,
                   "Names of what the observation's goal counts.")
      .def_prop_ro("episode_ids", &EnvironmentBatch::episode_ids,
                   "Of all episodes that can be done, in the order of their numbers.")
      .def_prop_ro("infeasible", &EnvironmentBatch::infeasible,
                   "How many episodes of the set the robot cannot do here; left out.")
      .def_prop_ro(
          "speed_limits",
          [](const EnvironmentBatch& batch) {
            return nb::make_tuple(batch.robot().max_forward_mps, batch.robot().max_turn_radps);
          },
          nb::sig("def speed_limits(self) -> tuple[float, float]"),
          "Of the robot: metres and radians per second.");
}

}  // namespace segsim::python

#include "worlds/mesh/gazebo/internal/world_document.h"

#include <algorithm>
#include <map>
#include <set>

#include <ignition/math/Pose3.hh>

#include "core/error.h"
#include "worlds/mesh/gazebo/internal/built_in_models.h"

namespace segsim::worlds::internal {
namespace {

namespace fs = std::filesystem;

/// @param user  Named in messages about missing models.
sdf::ParserConfig parser_config(const ResourceFinder& finder, BuiltInModels& built_in,
                                MissingFiles& missing, const std::string& user) {
  sdf::Console::Instance()->SetQuiet(true);  // Errors are returned, too.
  sdf::ParserConfig config;
  // Old worlds are full of both; the log file of libsdformat has them.
  config.SetWarningsPolicy(sdf::EnforcementPolicy::LOG);
  config.SetDeprecatedElementsPolicy(sdf::EnforcementPolicy::LOG);
  config.SetFindCallback([&finder, &built_in, &missing, user](const std::string& uri) {
    if (const auto found = finder.find(uri, {})) return found->string();
    if (const auto found = built_in.find(uri)) return found->string();
    missing.add(MissingKind::kModel, uri, user);
    return std::string();
  });
  return config;
}

/// Calls `visit` with every child of the kind.
template <class Visit>
void for_each_child(const sdf::ElementPtr& parent, const std::string& kind,
                    const Visit& visit) {
  if (!parent->HasElement(kind)) return;
  for (sdf::ElementPtr child = parent->GetElement(kind); child != nullptr;
       child = child->GetNextElement(kind)) {
    visit(child);
  }
}

/// Renames all but the first of equally named siblings, and goes on below them.
void number_names(const sdf::ElementPtr& parent) {
  for (const char* kind : {"model", "link", "visual", "collision"}) {
    std::set<std::string> names;
    for_each_child(parent, kind, [&](const sdf::ElementPtr& child) {
      names.insert(child->Get<std::string>("name"));
    });
    std::set<std::string> taken;
    for_each_child(parent, kind, [&](const sdf::ElementPtr& child) {
      const std::string name = child->Get<std::string>("name");
      std::string unique = name;
      for (int number = 0;
           taken.contains(unique) || (unique != name && names.contains(unique)); ++number) {
        unique = name + "_" + std::to_string(number);
      }
      taken.insert(unique);
      if (unique != name) child->GetAttribute("name")->SetFromString(unique);
      number_names(child);
    });
  }
}

/// Where models were when the world was saved; Gazebo starts from there.
void apply_state(const sdf::ElementPtr& world) {
  if (!world->HasElement("state")) return;
  std::map<std::string, ignition::math::Pose3d> poses;
  for_each_child(world->GetElement("state"), "model", [&](const sdf::ElementPtr& model) {
    if (model->HasElement("pose")) {
      poses.emplace(model->Get<std::string>("name"),
                    model->Get<ignition::math::Pose3d>("pose"));
    }
  });
  for_each_child(world, "model", [&](const sdf::ElementPtr& model) {
    const auto pose = poses.find(model->Get<std::string>("name"));
    if (pose == poses.end()) return;
    model->GetElement("pose")->Set(pose->second);
    poses.erase(pose);  // The second model of one name is elsewhere.
  });
}

/// Passes on what SDF reports, each message once. Models that were not found are known
/// already.
void report(const sdf::Errors& errors, const fs::path& file,
            std::vector<std::string>& warnings) {
  std::vector<std::string> messages;
  for (const sdf::Error& error : errors) {
    if (error.Code() == sdf::ErrorCode::URI_LOOKUP) continue;
    if (error.Code() == sdf::ErrorCode::FILE_READ) {
      throw core::InputError::expected(file.string(), "readable SDF with readable models",
                                       error.Message());
    }
    messages.push_back("SDF: " + error.Message());
  }
  for (auto message = messages.begin(); message != messages.end(); ++message) {
    if (std::find(messages.begin(), message, *message) != message) continue;
    const auto count = std::count(message, messages.end(), *message);
    warnings.push_back(count == 1 ? *message
                                  : *message + " (" + std::to_string(count) + " times)");
  }
}

}  // namespace

void read_world(const fs::path& world_file, const ResourceFinder& finder, sdf::Root& root,
                MissingFiles& missing, std::vector<std::string>& warnings) {
  if (!fs::is_regular_file(world_file)) {
    throw core::InputError::expected(world_file.string(), "a Gazebo world file", "none");
  }
  BuiltInModels built_in;
  const sdf::ParserConfig config =
      parser_config(finder, built_in, missing, world_file.filename().string());
  const auto document = std::make_shared<sdf::SDF>();
  sdf::Errors errors;
  sdf::init(document);
  const bool read = sdf::readFile(fs::absolute(world_file).string(), config, document, errors);
  if (!read || document->Root() == nullptr || !document->Root()->HasElement("world")) {
    throw core::InputError::expected(
        world_file.string(), "SDF with a world",
        errors.empty() ? std::string("none") : errors.front().Message());
  }
  report(errors, world_file, warnings);
  const sdf::ElementPtr world = document->Root()->GetElement("world");
  apply_state(world);
  number_names(world);
  report(root.Load(document, config), world_file, warnings);
  if (root.WorldCount() == 0) {
    throw core::InputError::expected(world_file.string(), "SDF with a world", "none");
  }
}

void read_model(const std::string& uri, const ResourceFinder& finder, sdf::Root& root,
                MissingFiles& missing, std::vector<std::string>& warnings) {
  const auto folder = finder.find(uri, {});
  if (!folder) throw core::InputError::expected(uri, "a model", "none");
  const fs::path file = *folder / "model.sdf";
  BuiltInModels built_in;
  const sdf::Errors errors =
      root.Load(file.string(), parser_config(finder, built_in, missing, uri));
  if (root.Model() == nullptr) {
    throw core::InputError::expected(file.string(), "SDF with a model",
                                     errors.empty() ? "none" : errors.front().Message());
  }
  report(errors, file, warnings);
}

}  // namespace segsim::worlds::internal

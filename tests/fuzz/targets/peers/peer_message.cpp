// Answers of a policy or detector in another process (docs/connect.md).
#include "peers/internal/messages.h"
#include "tests/fuzz/fuzz_target.h"

namespace segsim::fuzz {

void parse(const std::string& bytes) {
  const peers::internal::Json message = peers::internal::parse_message(bytes, "the peer");
  const peers::internal::Fields fields(message, "the peer");
  const std::string type = fields.text("type");
  if (type == "detections") {
    (void)peers::internal::read_detections(fields, 2);
  } else if (type == "ready") {
    (void)fields.texts("class_names");
  } else {
    (void)peers::internal::read_decision(fields);
    (void)peers::internal::read_view(fields);
  }
}

std::vector<std::string> seeds() {
  core::PolicyView view;
  view.path_m = {{0.5, 1.0}, {1.0, 1.5}};
  view.frontiers_m = {{3.0, -1.0}};
  view.target_m = glm::dvec2(1.0, 2.0);
  core::Decision decision;
  decision.stop = core::StopReason::kNothingNew;
  const std::vector<core::Detection> found{{1, 0.9F, {1.1F, 2.2F, 3.3F, 4.4F}}};
  const peers::internal::Json detections = {{"type", "detections"},
                                            {"detections", peers::internal::to_json(found)}};
  return {peers::internal::to_text(peers::internal::to_json(decision, view)),
          detections.dump(), R"({"type":"ready","class_names":["chair","couch"]})"};
}

}  // namespace segsim::fuzz

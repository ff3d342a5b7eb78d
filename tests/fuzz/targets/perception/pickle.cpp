// Pickles by themselves, without the archive around them (perception/checkpoint/pickle.h).
#include "perception/checkpoint/pickle.h"

#include "tests/fuzz/fuzz_target.h"
#include "tests/perception/checkpoint_writer.h"

namespace segsim::fuzz {

void parse(const std::string& bytes) {
  const perception::Pickle pickle = perception::Pickle::read(bytes, "input");
  const perception::PickleValue& root = pickle.at(pickle.root());
  for (const auto& [key, value] : root.pairs) (void)pickle.at(value);
  (void)pickle.find(pickle.root(), "state_dict");
}

std::vector<std::string> seeds() {
  using namespace perception::pickled;
  const std::string module =
      object("torch.nn.modules.conv", "Conv2d",
             {{text("_parameters"),
               ordered_dict({{text("w"), tensor("FloatStorage", "0", 6, 0, {2, 3}, {3, 1})}})},
              {text("training"), kTrue}});
  return {kBegin + module + kEnd,
          kBegin +
              dict({{text("names"), dict({{integer(0), text("chair")}})},
                    {text("shape"), integers({1, 2})},
                    {text("none"), kNone}}) +
              kEnd};
}

}  // namespace segsim::fuzz

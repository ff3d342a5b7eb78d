#pragma once

namespace segsim::nav::internal {

/// Text of nav/policies/data/semantic_prior.yaml; the build embeds it.
extern const char* const kSemanticPriorYaml;

}  // namespace segsim::nav::internal

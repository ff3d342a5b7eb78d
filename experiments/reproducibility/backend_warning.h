#pragma once

/// @file
/// What a user hears when `auto` finds no GPU.

#include <string>

namespace segsim::experiments::reproducibility {

/// For renderer::make_renderer(): the first reason goes to standard error, further ones (other
/// threads, other scenes) are not repeated.
void warn_about_backend(const std::string& reason);

}  // namespace segsim::experiments::reproducibility

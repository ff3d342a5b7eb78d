#include "python/native/frame_file.h"

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include "core/error.h"
#include "python/native/frame_arrays.h"
#include "renderer/files/exr_io.h"

namespace segsim::python {
namespace {

namespace nb = nanobind;
using namespace nb::literals;

nb::dict read_frame(const std::filesystem::path& file, std::vector<std::string> channels) {
  const ChannelChoice choice(std::move(channels));
  core::Frame frame;
  {
    const nb::gil_scoped_release released;
    frame = renderer::read_frame_exr(file);
  }
  const std::string missing = missing_image(frame, choice);
  if (!missing.empty()) {
    throw core::InputError::expected(file.string(), "an image \"" + missing + "\"", "none");
  }
  return take_images(std::move(frame), choice);
}

}  // namespace

void bind_frame_files(nb::module_& module) {
  module.def("read_frame", &read_frame, "file"_a,
             "channels"_a = std::vector<std::string>{"rgb", "depth"},
             nb::sig("def read_frame(file: str | os.PathLike[str], channels: "
                     "collections.abc.Sequence[str] = ('rgb', 'depth')) -> "
                     "dict[str, numpy.typing.NDArray[typing.Any]]"),
             "Images of a frame that `segsim run` recorded (`frames` in a spec) or `segsim "
             "render` wrote, an OpenEXR file: arrays as Renderer.render() returns them.\n\n"
             "Raises InputError for a file that is damaged, is none of these, or lacks one "
             "of the images.");
}

}  // namespace segsim::python

#include "experiments/trials/frame_recorder.h"

#include <memory>
#include <string>
#include <utility>

#include "core/check.h"

namespace segsim::experiments::trials {
namespace {

namespace fs = std::filesystem;

/// A shorter trial must not seem to go on with an older one's frames.
void remove_frames(const fs::path& folder) {
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, error)) {
    const std::string name = entry.path().filename().string();
    if (name.starts_with("frame-") && name.ends_with(".exr")) fs::remove(entry.path(), error);
  }
}

}  // namespace

FrameRecorder::FrameRecorder(fs::path folder, const core::SceneBundle& bundle, int every_ticks,
                             core::Renderer& renderer)
    : folder_(std::move(folder)), renderer_(renderer), every_ticks_(every_ticks) {
  SEGSIM_CHECK(every_ticks > 0, "every_ticks");
  remove_frames(folder_);
  info_.scene = bundle.manifest.name;
  info_.scene_sha256 = bundle.scene_sha256;
  info_.names =
      std::make_shared<const renderer::SceneNames>(renderer::SceneNames::of(bundle.manifest));
}

void FrameRecorder::add(const sim::TickRecord& tick, const core::Frame& seen) {
  const int number = tick_++;
  if (number % every_ticks_ != 0) return;
  renderer_.render(seen.T_world_camera, seen.intrinsics, core::Channels::kAll, frame_);
  info_.time_ns = tick.time_ns;
  writer_.push(folder_ / renderer::sequence_file_name(number), std::move(frame_), info_);
}

void FrameRecorder::finish() { writer_.close(); }

}  // namespace segsim::experiments::trials

#include "experiments/video/trial_video.h"

#include "experiments/video/trial_page.h"
#include "experiments/video/video_file.h"

namespace segsim::experiments::video {

struct TrialVideo::Impl {
  internal::VideoFile file;
  internal::TrialPage page;
};

TrialVideo::TrialVideo(std::filesystem::path file, const drawing::TrialScene& scene,
                       std::vector<std::string> detector_classes, double frames_per_s)
    : impl_(new Impl{{std::move(file), frames_per_s},
                     {scene, std::move(detector_classes), internal::PageForm::kWide}}) {}

TrialVideo::~TrialVideo() = default;

void TrialVideo::add(const sim::TickRecord& tick, const core::Frame& frame,
                     std::span<const core::Detection> detections,
                     const core::PolicyView& view) {
  impl_->file.write(impl_->page.draw(tick, frame, detections, view));
}

void TrialVideo::finish(const sim::TrialResult& result) {
  if (impl_->file.frames() == 0) return;
  impl_->file.write(impl_->page.draw_outcome(result));
  impl_->file.hold(2.0);
  impl_->file.finish();
}

}  // namespace segsim::experiments::video

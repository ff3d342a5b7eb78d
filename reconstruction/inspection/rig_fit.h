#pragma once

/// @file
/// Where the depth camera stands against the colour camera, and how their clocks differ, found
/// in the recording itself: contours in depth, where a near surface ends, are edges in colour.
/// Contours of many frames are brought into the colour pictures, and the offset at which most
/// of them lie on an edge that runs as they do is the true one.
///
/// The search begins with shifts of the whole picture and goes on by weighted Gauss-Newton on
/// the distance to the next edge, with a reach that shrinks from 6 pixels to 1, so that
/// contours without an edge in colour lose their say (Welsch's estimator). How sure the result
/// is tell the same fits without a quarter of the frames (jackknife).

#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "reconstruction/datasets/color_depth.h"
#include "reconstruction/datasets/rgbd_sequence.h"

namespace segsim::reconstruction {

/// What is kept of a frame: tens of kilobytes, however large its images.
class RigView {
 public:
  /// @param frame  With depth, as `sequence` loads it.
  RigView(const RgbdSequence& sequence, std::size_t i, const RgbdFrame& frame);
  ~RigView();
  RigView(RigView&&) noexcept;
  RigView& operator=(RigView&&) noexcept;

  struct Impl;
  [[nodiscard]] const Impl& impl() const { return *impl_; }

 private:
  std::unique_ptr<Impl> impl_;
};

struct RigOffset {
  /// From depth as the recording was opened to depth as it ought to be.
  CameraToCamera T_color_depth;
  double depth_time_s = 0.0;  ///< What is to be added to the stamps of depth images.
};

struct RigFitOptions {
  bool fit_place = true;  ///< Six degrees of freedom of T_color_depth.
  bool fit_time = false;  ///< Needs time stamps of depth, and poses by time.
  RigOffset start;        ///< What is not fitted stays as it is here.
  /// The camera's motion between a depth image and a colour image is allowed for; fit_time
  /// needs it.
  bool use_times = false;
};

struct RigFit {
  RigOffset offset;
  // Standard errors.
  double rotation_error_deg = 0.0, translation_error_m = 0.0, time_error_s = 0.0;
  /// Share of contours on edges, 0 to 1: at the start, at the offset, and by chance.
  double given = 0.0, best = 0.0, chance = 0.0;
  /// By which the offset moves contours, the middle one, and its standard error [px of the
  /// colour image].
  double displacement_px = 0.0, error_px = 0.0;
  std::size_t views = 0, contour_points = 0;
  /// Why the offset must not be trusted, in words; empty if it may be.
  std::string doubt;

  /// Trusted, and more than what edges cannot tell from nothing.
  [[nodiscard]] bool is_off() const;
  /// "2.5 cm left, 0.3 cm up, 0.1 cm back; turned by 0.2 degrees ... (agreement 0.51 instead
  /// of 0.34, 0.12 by chance; moves depth by 2.9 +- 0.1 px)"
  [[nodiscard]] std::string text(const RigFitOptions& options) const;
};

/// @param camera  RgbdSequence::intrinsics() of the views.
/// @param track  RgbdSequence::pose_track(); may be empty without use_times.
[[nodiscard]] RigFit fit_rig(const std::vector<const RigView*>& views,
                             const core::CameraIntrinsics& camera, const PoseTrack& track,
                             const RigFitOptions& options);

/// The same with up to `most_views` views, loaded here: spread evenly over the recording, and
/// with fit_time those of each part that move most.
/// @throws InputError if a frame cannot be read.
[[nodiscard]] RigFit fit_rig(const RgbdSequence& sequence, const RigFitOptions& options,
                             std::size_t most_views = 60);

}  // namespace segsim::reconstruction

# Files that need libtorch and no other library: also what a bare GPU machine builds
# (tests/renderer/cuda_minimal). Relative to this folder.
set(SEGSIM_LABEL_TRAINING_SOURCES
  internal/tensors/adam.cpp internal/tensors/state_file.cpp
  labels/assignment.cpp labels/mask_association.cpp labels/panoptic_head.cpp labels/panoptic_head_names.cpp labels/panoptic_lifting.cpp
  labels/panoptic_splatting.cpp labels/panoptic_training.cpp labels/pixel_sampling.cpp
  labels/query_head.cpp labels/query_pruning.cpp labels/query_seeding.cpp
  labels/internal/attention.cpp labels/internal/batch_targets.cpp labels/internal/head_support.cpp
  labels/internal/label_losses.cpp labels/internal/query_matching.cpp labels/internal/query_set.cpp
  labels/internal/sparse_blend.cpp)
set(SEGSIM_GEOMETRY_TRAINING_SOURCES
  training/densify.cpp training/geometry_training.cpp training/pose_alignment.cpp
  training/raw_surfels.cpp training/training_memory.cpp training/training_pack.cpp
  training/training_set.cpp training/training_views.cpp training/internal/geometry_losses.cpp
  training/internal/pose_gradient.cpp training/internal/raster_function.cpp
  training/internal/surfel_state.cpp training/internal/training_poses.cpp
  training/internal/view_loss.cpp)

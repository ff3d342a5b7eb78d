# Files that need libtorch and no other library of the project's: also what a bare GPU machine
# builds (tests/renderer/cuda_minimal). Relative to this folder.
set(SEGSIM_LABEL_TRAINING_SOURCES
  assignment.cpp mask_association.cpp panoptic_training.cpp pixel_sampling.cpp query_pruning.cpp query_seeding.cpp
  heads/panoptic_head.cpp heads/panoptic_lifting.cpp heads/panoptic_splatting.cpp heads/query_head.cpp
  heads/internal/adam.cpp heads/internal/attention.cpp heads/internal/batch_targets.cpp
  heads/internal/head_support.cpp heads/internal/label_losses.cpp heads/internal/query_matching.cpp
  heads/internal/query_set.cpp heads/internal/sparse_blend.cpp heads/internal/state_file.cpp)
set(SEGSIM_GEOMETRY_TRAINING_SOURCES
  densify.cpp geometry_training.cpp pose_alignment.cpp raw_surfels.cpp training_memory.cpp
  training_pack.cpp training_set.cpp
  training_views.cpp internal/geometry_losses.cpp internal/pose_gradient.cpp internal/raster_function.cpp
  internal/surfel_state.cpp internal/training_poses.cpp internal/view_loss.cpp)

# Files that need libtorch and no other library: also what a bare GPU machine builds
# (tests/perception/cuda_minimal). Relative to this folder.
set(SEGSIM_DETECTOR_NETWORK_SOURCES
  device_frame_tensors.cpp letterbox.cpp nms.cpp tensor_difference.cpp
  internal/assigner.cpp internal/detection_loss.cpp internal/frame_stream.cpp internal/inference.cpp
  internal/inference_network.cpp internal/loss_targets.cpp internal/loss_targets_device.cpp
  internal/network.cpp internal/onednn.cpp internal/onednn_attention.cpp
  internal/trainable_network.cpp internal/training_step.cpp
  yolov13/scale.cpp
  yolov13/internal/attention.cpp yolov13/internal/blocks.cpp yolov13/internal/hypergraph.cpp
  yolov13/internal/network.cpp)

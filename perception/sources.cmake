# Files that need libtorch and no other library: also what a bare GPU machine builds
# (tests/perception/cuda_minimal). Relative to this folder.
set(SEGSIM_DETECTOR_NETWORK_SOURCES
  data/letterbox.cpp data/nms.cpp
  checkpoint/tensor_difference.cpp checkpoint/yolov13_scale.cpp
  internal/network/network.cpp internal/network/onednn.cpp internal/network/onednn_attention.cpp
  internal/loss/assigner.cpp internal/loss/detection_loss.cpp internal/loss/loss_targets.cpp
  internal/loss/loss_targets_device.cpp
  internal/yolov13/attention.cpp internal/yolov13/blocks.cpp internal/yolov13/hypergraph.cpp
  internal/yolov13/network.cpp
  detector/device_frame_tensors.cpp detector/internal/frame_stream.cpp detector/internal/inference.cpp
  detector/internal/inference_network.cpp
  training/internal/trainable_network.cpp training/internal/training_step.cpp)

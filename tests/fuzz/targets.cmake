# The targets, area by area.
segsim_fuzz_target(core/yaml LIBRARIES segsim::core DICTIONARY yaml)
segsim_fuzz_target(core/picture LIBRARIES segsim::files DICTIONARY picture)
segsim_fuzz_target(core/manifest LIBRARIES segsim::core DICTIONARY yaml)
segsim_fuzz_target(core/camera_path LIBRARIES segsim::core)

segsim_fuzz_target(renderer/surfels_ply LIBRARIES segsim::ply DICTIONARY ply)
segsim_fuzz_target(renderer/panoptic_model LIBRARIES segsim::surfel_files)
segsim_fuzz_target(renderer/label_field LIBRARIES segsim::surfel_files)
segsim_fuzz_target(renderer/label_edits LIBRARIES segsim::surfel_files)
segsim_fuzz_target(renderer/exr LIBRARIES segsim::surfel_files DICTIONARY exr)
segsim_fuzz_target(renderer/cryptomatte LIBRARIES segsim::surfel_files DICTIONARY json)

segsim_fuzz_target(ros/cdr LIBRARIES segsim::ros)
segsim_fuzz_target(ros/mcap LIBRARIES segsim::mcap DICTIONARY mcap)
segsim_fuzz_target(peers/peer_message LIBRARIES segsim::peers DICTIONARY json)
segsim_fuzz_target(peers/peer_channel LIBRARIES segsim::peers DICTIONARY json)

segsim_fuzz_target(sim/navmesh LIBRARIES segsim::ground)
segsim_fuzz_target(sim/collision_mesh LIBRARIES segsim::ground DICTIONARY ply)
segsim_fuzz_target(sim/robot LIBRARIES segsim::ground DICTIONARY yaml)

foreach(name boxes masks coco_panoptic nerfstudio)
  segsim_fuzz_target(reconstruction/${name} LIBRARIES segsim::datasets DICTIONARY json)
endforeach()
segsim_fuzz_target(reconstruction/pictures LIBRARIES segsim::datasets DICTIONARY picture)
segsim_fuzz_target(reconstruction/colmap LIBRARIES segsim::datasets)
segsim_fuzz_target(reconstruction/recording_text LIBRARIES segsim::datasets DICTIONARY yaml)
segsim_fuzz_target(reconstruction/point_cloud LIBRARIES segsim::datasets DICTIONARY ply)
find_package(OpenCV REQUIRED COMPONENTS core imgcodecs)
foreach(name pictures coco_panoptic nerfstudio)  # They make pictures.
  segsim_link_third_party(fuzz_${name} opencv_core opencv_imgcodecs)
  target_include_directories(fuzz_${name} SYSTEM PRIVATE ${OpenCV_INCLUDE_DIRS})
endforeach()

# What reads the files of the detectors needs no libtorch.
segsim_fuzz_part(perception OF segsim::perception USES segsim::core
  FILES perception/data/class_map.cpp perception/data/dataset.cpp perception/data/image_file.cpp
    perception/data/scene_json.cpp perception/evaluation/coco_results.cpp perception/checkpoint/lineage.cpp
    perception/checkpoint/pickle.cpp perception/checkpoint/safetensors.cpp perception/checkpoint/tensor_difference.cpp
    perception/checkpoint/tensor_file.cpp
    perception/checkpoint/tfjs.cpp perception/checkpoint/torch_zip.cpp perception/checkpoint/weights_file.cpp
    perception/checkpoint/yolov13_scale.cpp perception/checkpoint/zip_file.cpp
  THIRD_PARTY nlohmann_json::nlohmann_json opencv_core opencv_imgproc opencv_imgcodecs)
foreach(name tensor_archive pickle weights)
  segsim_fuzz_target(perception/${name} LIBRARIES fuzz_part_perception DICTIONARY weights)
endforeach()
segsim_fuzz_target(perception/tfjs LIBRARIES fuzz_part_perception DICTIONARY json)
segsim_fuzz_target(perception/coco LIBRARIES fuzz_part_perception DICTIONARY json)
segsim_fuzz_target(perception/class_map LIBRARIES fuzz_part_perception DICTIONARY yaml)

find_package(Protobuf REQUIRED)
segsim_fuzz_part(tokenizers OF segsim::models USES segsim::core
  FILES perception/models/text/tokenizer.cpp perception/models/text/internal/clip_tokenizer.cpp
    perception/models/text/internal/unicode.cpp perception/models/text/internal/unigram_tokenizer.cpp
    perception/models/text/internal/word_piece_tokenizer.cpp
  THIRD_PARTY protobuf::libprotobuf)
segsim_fuzz_target(perception/tokenizer LIBRARIES fuzz_part_tokenizers)

find_package(assimp REQUIRED)
find_package(sdformat12 REQUIRED)
find_package(PkgConfig REQUIRED)
pkg_check_modules(minizip REQUIRED IMPORTED_TARGET minizip)
segsim_fuzz_part(worlds OF segsim::worlds USES segsim::ground
  FILES worlds/mesh/blank_textures.cpp worlds/mesh/class_names.cpp worlds/mesh/collada_check.cpp
    worlds/mesh/image_textures.cpp
    worlds/mesh/mesh_builder.cpp worlds/mesh/mesh_import.cpp worlds/mesh/mesh_parts.cpp
    worlds/mesh/number_mending.cpp worlds/mesh/plain_mesh.cpp
    worlds/mesh/furniture/furniture_catalogue.cpp worlds/mesh/furniture/furniture_mesh.cpp
    worlds/mesh/furniture/zip_archive.cpp
    worlds/mesh/gazebo/built_in_models.cpp worlds/mesh/gazebo/ceiling.cpp worlds/mesh/gazebo/gazebo_import.cpp
    worlds/mesh/gazebo/gazebo_materials.cpp worlds/mesh/gazebo/material_script.cpp
    worlds/mesh/gazebo/missing_files.cpp worlds/mesh/gazebo/primitive_shapes.cpp
    worlds/mesh/gazebo/resource_finder.cpp worlds/mesh/gazebo/texture_names.cpp
    worlds/mesh/gazebo/visual_materials.cpp worlds/mesh/gazebo/world_document.cpp
    worlds/mesh/gazebo/world_plan.cpp worlds/capture/capture_plan.cpp
  THIRD_PARTY assimp::assimp sdformat12::sdformat12 PkgConfig::minizip opencv_core opencv_imgcodecs opencv_imgproc)
segsim_fuzz_target(worlds/mesh_obj LIBRARIES fuzz_part_worlds DICTIONARY obj)
if(SEGSIM_FUZZ)
  target_sources(fuzz_mesh_obj PRIVATE large_block.cpp)
endif()
segsim_fuzz_target(worlds/mesh_ply LIBRARIES fuzz_part_worlds DICTIONARY ply)
segsim_fuzz_target(worlds/mesh_gltf LIBRARIES fuzz_part_worlds DICTIONARY json)
segsim_fuzz_target(worlds/mesh_dae LIBRARIES fuzz_part_worlds GTest::gtest DICTIONARY xml)
segsim_fuzz_target(worlds/gazebo_world LIBRARIES fuzz_part_worlds DICTIONARY xml)
pkg_check_modules(tinyxml2 REQUIRED IMPORTED_TARGET tinyxml2)  # Comes with libsdformat.
segsim_link_third_party(fuzz_gazebo_world PkgConfig::tinyxml2)
segsim_fuzz_target(worlds/furniture_library LIBRARIES fuzz_part_worlds)
segsim_fuzz_target(worlds/trajectory LIBRARIES fuzz_part_worlds)
segsim_link_third_party(fuzz_furniture_library PkgConfig::minizip)

pkg_check_modules(CPP_HTTPLIB REQUIRED cpp-httplib)
segsim_fuzz_part(web OF segsim::experiments_web USES segsim::core
  FILES experiments/web/http_server.cpp experiments/web/internal/front_door.cpp
    experiments/web/internal/request_bytes.cpp
  THIRD_PARTY nlohmann_json::nlohmann_json ${CPP_HTTPLIB_LINK_LIBRARIES})
segsim_fuzz_target(experiments/http_request LIBRARIES fuzz_part_web DICTIONARY http)
segsim_fuzz_target(experiments/http_server LIBRARIES fuzz_part_web DICTIONARY http)

find_package(SQLite3 REQUIRED)
find_package(ZLIB REQUIRED)
segsim_fuzz_part(bags OF segsim::experiments_bags USES segsim::mcap
  FILES experiments/bags/bag_file.cpp
  THIRD_PARTY SQLite::SQLite3)
segsim_fuzz_target(experiments/rosbag_database LIBRARIES fuzz_part_bags DICTIONARY sql)
segsim_link_third_party(fuzz_rosbag_database SQLite::SQLite3)

# The simulator's words and records, without what runs trials.
segsim_fuzz_part(records OF segsim::experiments_suites segsim::experiments_episodes
    segsim::experiments_scripted_trials
  USES segsim::surfel_files segsim::ground
  FILES experiments/support/gzip_file.cpp experiments/support/text_grid.cpp experiments/support/shipped_file.cpp
    experiments/episodes/episode_file.cpp experiments/episodes/habitat_read.cpp
    experiments/records/failure_cause.cpp experiments/records/results_digest.cpp experiments/records/row_words.cpp
    experiments/records/scene_exposure.cpp experiments/records/store.cpp experiments/records/store_csv.cpp
    experiments/records/store_trials.cpp
    experiments/records/trial_outcome.cpp experiments/records/trial_row.cpp
    experiments/records/trial_witness.cpp experiments/records/internal/store_schema.cpp
    experiments/scripted_trials/geo_path.cpp experiments/suites/layered_yaml.cpp
    experiments/suites/manifest.cpp experiments/suites/suite.cpp
    sim/trial/goal_objects.cpp sim/trial/outcome.cpp
  THIRD_PARTY SQLite::SQLite3 ZLIB::ZLIB nlohmann_json::nlohmann_json)
segsim_fuzz_target(experiments/episode_set LIBRARIES fuzz_part_records DICTIONARY json)
segsim_fuzz_target(experiments/habitat_episodes LIBRARIES fuzz_part_records DICTIONARY json)
segsim_fuzz_target(experiments/results_database LIBRARIES fuzz_part_records DICTIONARY sql)
segsim_fuzz_target(experiments/geojson LIBRARIES fuzz_part_records DICTIONARY json)
segsim_fuzz_target(experiments/suite LIBRARIES fuzz_part_records DICTIONARY yaml)
segsim_link_third_party(fuzz_results_database SQLite::SQLite3)

# Specs name policies and sensors, and so need all of them.
segsim_fuzz_part(specs OF segsim::experiments_scripted_trials USES segsim::nav segsim::sim segsim::datasets
  FILES experiments/specs/budget_file.cpp experiments/specs/clock_spec.cpp experiments/specs/gazebo_spec.cpp
    experiments/specs/home_spec.cpp experiments/specs/rig_spec.cpp experiments/specs/sensor_spec.cpp
    experiments/specs/spec.cpp experiments/specs/tuning_set.cpp experiments/specs/internal/spec_arms.cpp
    experiments/specs/internal/spec_motion.cpp
    experiments/specs/internal/spec_phrases.cpp experiments/specs/internal/spec_repetitions.cpp
    experiments/specs/internal/spec_scenes.cpp experiments/scripted_trials/geo_path.cpp
    experiments/scripted_trials/scripted_trial.cpp experiments/scripted_trials/scripted_trial_steps.cpp
    experiments/support/shipped_file.cpp reconstruction/labels/panoptic_head_names.cpp
  THIRD_PARTY nlohmann_json::nlohmann_json)
segsim_fuzz_part(trial_logs OF segsim::experiments_records USES segsim::sim segsim::surfel_files
  FILES experiments/support/gzip_file.cpp experiments/records/failure_cause.cpp experiments/records/replay_log.cpp
    experiments/records/scene_exposure.cpp experiments/records/trial_log.cpp
    experiments/records/trial_outcome.cpp experiments/records/trial_witness.cpp
  THIRD_PARTY ZLIB::ZLIB nlohmann_json::nlohmann_json)
segsim_fuzz_target(experiments/trial_logs LIBRARIES fuzz_part_trial_logs DICTIONARY json)
segsim_fuzz_target(experiments/latency_budget LIBRARIES fuzz_part_specs DICTIONARY yaml)
segsim_fuzz_target(experiments/experiment_spec LIBRARIES fuzz_part_specs DICTIONARY yaml)
segsim_fuzz_target(experiments/scripted_trial LIBRARIES fuzz_part_specs DICTIONARY yaml)

# On ATen: libtorch.
find_package(ONNX CONFIG REQUIRED)
segsim_fuzz_part(onnx OF segsim::models USES fuzz_part_perception
  FILES perception/models/model_session.cpp perception/models/internal/host_tensor_convert.cpp
    perception/models/internal/onnx/onnx_executor.cpp perception/models/internal/onnx/onnx_node_call.cpp
    perception/models/internal/onnx/onnx_operators.cpp perception/models/internal/onnx/onnx_ops_elementwise.cpp
    perception/models/internal/onnx/onnx_ops_flow.cpp perception/models/internal/onnx/onnx_ops_index.cpp
    perception/models/internal/onnx/onnx_ops_matrix.cpp perception/models/internal/onnx/onnx_ops_norm.cpp
    perception/models/internal/onnx/onnx_ops_reduce.cpp perception/models/internal/onnx/onnx_ops_region.cpp
    perception/models/internal/onnx/onnx_ops_resample.cpp perception/models/internal/onnx/onnx_ops_shape.cpp
    perception/models/internal/onnx/onnx_ops_window.cpp perception/models/internal/onnx/onnx_reader.cpp
    perception/models/internal/onnx/onnx_session.cpp perception/models/internal/onnx/onnx_tensor.cpp
    perception/models/internal/resample.cpp perception/models/internal/roi_align.cpp
    perception/models/internal/torchscript_session.cpp
  THIRD_PARTY torch torch_cpu onnx_proto protobuf::libprotobuf)
segsim_fuzz_target(perception/onnx_graph LIBRARIES fuzz_part_onnx)
if(SEGSIM_FUZZ)
  segsim_find_torch()
  target_sources(fuzz_onnx_graph PRIVATE one_thread.cpp)
  target_include_directories(fuzz_part_onnx SYSTEM PRIVATE ${TORCH_INCLUDE_DIRS})
  target_compile_options(fuzz_part_onnx PRIVATE -include ${CMAKE_CURRENT_SOURCE_DIR}/clang_vector.h)
endif()
segsim_link_third_party(fuzz_onnx_graph onnx_proto protobuf::libprotobuf)

# Adds the GPU backend to a library that has the rest of the renderer.
#
# project.cu decides the order of surfels and must round as the CPU does: no contraction. In
# raster.cu roots and quotients only bound, or meet a tolerance of 1e-4: approximate ones do.
function(segsim_add_cuda_renderer target)
  set(folder ${PROJECT_SOURCE_DIR}/renderer/cuda)
  target_sources(${target} PRIVATE
    ${folder}/cuda_renderer.cpp ${folder}/device_images.cpp
    ${folder}/device_memory.cpp ${folder}/device_scene.cpp
    ${folder}/frame.cu ${folder}/project.cu
    ${folder}/raster.cu ${folder}/raster_many.cu)
  set_source_files_properties(${folder}/project.cu TARGET_DIRECTORY ${target}
    PROPERTIES COMPILE_OPTIONS "-fmad=false;-prec-sqrt=false")
  set_source_files_properties(${folder}/raster.cu ${folder}/raster_many.cu
    TARGET_DIRECTORY ${target} PROPERTIES COMPILE_OPTIONS "-prec-sqrt=false;-prec-div=false")
  target_compile_definitions(${target} PRIVATE SEGSIM_WITH_CUDA=1)
  target_link_libraries(${target} PUBLIC CUDA::cudart_static)
endfunction()

# Adds the GPU's differentiable rasterizer to a library that has the GPU backend.
#
# rasterizer/cuda/project.cu is compiled as project.cu is, for the same reason. The others are held
# to tolerances of 1e-4: fast intrinsics of exp, roots and quotients do.
function(segsim_add_cuda_training target)
  set(folder ${PROJECT_SOURCE_DIR}/reconstruction/rasterizer/cuda)
  target_sources(${target} PRIVATE
    ${folder}/cuda_rasterizer.cpp
    ${folder}/project.cu ${folder}/forward.cu ${folder}/backward.cu ${folder}/gradients.cu
    ${folder}/weights.cu)
  set_source_files_properties(${folder}/project.cu TARGET_DIRECTORY ${target}
    PROPERTIES COMPILE_OPTIONS "-fmad=false;-prec-sqrt=false")
  set_source_files_properties(${folder}/forward.cu ${folder}/backward.cu ${folder}/weights.cu
    TARGET_DIRECTORY ${target} PROPERTIES COMPILE_OPTIONS "-use_fast_math")
  target_compile_definitions(${target} PUBLIC SEGSIM_WITH_CUDA_TRAINING=1)
endfunction()

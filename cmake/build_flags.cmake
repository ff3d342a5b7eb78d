# segsim::build_flags: what every target of ours is compiled with. Linked PRIVATE, so it
# never reaches a dependency or a dependent. Sanitizers are not here: they must reach
# every object file, so CMakePresets.json sets them in CMAKE_CXX_FLAGS.
add_library(segsim_build_flags INTERFACE)
add_library(segsim::build_flags ALIAS segsim_build_flags)

target_compile_features(segsim_build_flags INTERFACE cxx_std_20)

set(gcc_like_warnings -Wall -Wextra -Wpedantic -Wshadow -Wconversion
    -Wno-sign-conversion -Wnon-virtual-dtor -Wold-style-cast)
if(SEGSIM_WARNINGS_AS_ERRORS)
  list(APPEND gcc_like_warnings -Werror)
endif()

# No -ffast-math: it removes every NaN check, and depth images use NaN for "no return".
# No contraction of a*b+c: results must not depend on which instructions the target has.
target_compile_options(segsim_build_flags INTERFACE
  "$<$<COMPILE_LANGUAGE:CXX>:${gcc_like_warnings};-ffp-contract=off>"
  # CMake 3.25 does not know cuda_std_20.
  "$<$<COMPILE_LANGUAGE:CUDA>:-std=c++20>"
  # GLM 0.9.9.8 reads CUDA_VERSION without including cuda.h; #20012 is noise from it.
  "$<$<COMPILE_LANGUAGE:CUDA>:SHELL:-include cuda.h --diag-suppress=20012>"
  "$<$<COMPILE_LANGUAGE:CUDA>:SHELL:-Xcompiler -Wall,-Wextra>")
target_compile_definitions(segsim_build_flags INTERFACE
  $<$<COMPILE_LANGUAGE:CUDA>:GLM_FORCE_CUDA>)

# Many a fault that gets past the checks of input shall end the program, not be used. -O0 has no
# fortified functions, and sanitizers have checks of their own that fortified functions would hide.
option(SEGSIM_HARDENING "Checks of stack, buffers and containers, and read-only relocations" ON)
if(SEGSIM_HARDENING AND NOT CMAKE_CXX_FLAGS MATCHES "-fsanitize=")
  include(CheckCXXCompilerFlag)
  set(hardening -fstack-protector-strong)
  foreach(flag -fcf-protection -fstack-clash-protection)
    string(MAKE_C_IDENTIFIER "SEGSIM_HAS${flag}" known)
    check_cxx_compiler_flag(${flag} ${known})
    if(${known})
      list(APPEND hardening ${flag})
    endif()
  endforeach()
  target_compile_definitions(segsim_build_flags INTERFACE
    $<$<COMPILE_LANGUAGE:CXX>:_GLIBCXX_ASSERTIONS>)
  # An option, which follows CMAKE_CXX_FLAGS: a packager's own level must not be a redefinition.
  target_compile_options(segsim_build_flags INTERFACE "$<$<COMPILE_LANGUAGE:CXX>:${hardening}>"
    "$<$<AND:$<COMPILE_LANGUAGE:CXX>,$<CONFIG:Release,RelWithDebInfo,MinSizeRel>>:-U_FORTIFY_SOURCE;-D_FORTIFY_SOURCE=2>")
  add_link_options(LINKER:-z,relro,-z,now)
endif()

# For libraries that read no input and spend their time in loops over surfels and pixels: checked
# containers make the renderer 1.6 % slower.
function(segsim_without_container_checks target)
  if(SEGSIM_HARDENING)
    target_compile_options(${target} PRIVATE
      "$<$<AND:$<COMPILE_LANGUAGE:CXX>,$<NOT:$<CONFIG:Debug>>>:-U_GLIBCXX_ASSERTIONS>")
  endif()
  # Instrumented for every processor that Highway knows, one file takes ten minutes to compile.
  if(SEGSIM_FUZZ)
    target_compile_options(${target} PRIVATE -fno-sanitize=all)
  endif()
endfunction()

# Headers of other projects are included as system headers: their warnings are not ours.
function(segsim_link_third_party target)
  foreach(library ${ARGN})
    target_link_libraries(${target} PRIVATE ${library})
    if(TARGET ${library})
      get_target_property(includes ${library} INTERFACE_INCLUDE_DIRECTORIES)
      if(includes)
        target_include_directories(${target} SYSTEM PRIVATE ${includes})
      endif()
    endif()
  endforeach()
endfunction()

# Static libraries name all that any of their files needs; a program loads what its own files need.
add_link_options(-Wl,--as-needed)

# libtorch's package forces libtorch on every program, also on those that use none of it. With CUDA
# it has to: nothing names the symbols of libtorch_cuda.
macro(segsim_find_torch)
  if(NOT TARGET torch)
    if(CMAKE_CUDA_ARCHITECTURES MATCHES "^[0-9]+$" AND NOT DEFINED TORCH_CUDA_ARCH_LIST)
      # It would add every architecture that it has ever had, of which this nvcc may lack some.
      string(REGEX REPLACE "([0-9])$" ".\\1" TORCH_CUDA_ARCH_LIST ${CMAKE_CUDA_ARCHITECTURES})
    endif()
    find_package(Torch REQUIRED)
  endif()
  if(NOT TARGET torch_cuda)
    set_target_properties(torch_cpu_library PROPERTIES
      INTERFACE_LINK_LIBRARIES "torch_cpu;$<TARGET_PROPERTY:torch_cpu,INTERFACE_LINK_LIBRARIES>")
  endif()
endmacro()

# Fast linker and compiler cache when they are installed.
find_program(segsim_ccache ccache)
if(segsim_ccache)
  # Paths relative to the project, so that one clone has what another one compiled.
  set(segsim_launcher ${CMAKE_COMMAND} -E env
    CCACHE_BASEDIR=${PROJECT_SOURCE_DIR} CCACHE_NOHASHDIR=1 ${segsim_ccache})
  set(CMAKE_CXX_COMPILER_LAUNCHER ${segsim_launcher})
  set(CMAKE_CUDA_COMPILER_LAUNCHER ${segsim_launcher})
endif()
find_program(segsim_mold mold)
if(segsim_mold)
  add_link_options(-fuse-ld=mold)
endif()

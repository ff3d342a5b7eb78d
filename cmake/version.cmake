# segsim_add_version(<target>) makes the header that core/version.cpp of that target includes. The commit is looked up at
# every build, so that results name the code that made them.
function(segsim_add_version target)
  set(header ${CMAKE_CURRENT_BINARY_DIR}/generated/core_version.h)
  add_custom_target(segsim_version
    COMMAND ${CMAKE_COMMAND} -DSOURCE_DIR=${PROJECT_SOURCE_DIR} -DVERSION=${PROJECT_VERSION}
      -DOUTPUT=${header} -P ${PROJECT_SOURCE_DIR}/cmake/write_version.cmake
    BYPRODUCTS ${header}
    COMMENT "")
  add_dependencies(${target} segsim_version)
  target_include_directories(${target} PRIVATE ${CMAKE_CURRENT_BINARY_DIR}/generated)
endfunction()

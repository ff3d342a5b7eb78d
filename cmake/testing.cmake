# segsim_add_test(<module> <name> [library...]) builds <name>_test.cpp, which lies in tests/<module> or in the
# folder there of the room that it tests, and registers it as "<module>/<name>": one process per file, because
# the libraries behind OpenCV and libtorch take 0.4 s to load. `ctest -L <module>` runs one module's tests.
find_package(GTest REQUIRED)
find_package(benchmark REQUIRED)

function(segsim_find_test_source variable file)
  file(GLOB found ${CMAKE_CURRENT_SOURCE_DIR}/${file} ${CMAKE_CURRENT_SOURCE_DIR}/*/${file})
  list(LENGTH found count)
  if(NOT count EQUAL 1)
    message(FATAL_ERROR "${CMAKE_CURRENT_SOURCE_DIR} and its folders hold ${count} files ${file}, expected one")
  endif()
  set(${variable} ${found} PARENT_SCOPE)
endfunction()

function(segsim_add_test module name)
  set(target ${module}_${name}_test)
  segsim_find_test_source(source ${name}_test.cpp)
  add_executable(${target} ${source})
  target_link_libraries(${target} PRIVATE ${ARGN} segsim::core segsim::build_flags GTest::gmock_main)
  add_test(NAME ${module}/${name} COMMAND ${target})
  set_tests_properties(${module}/${name} PROPERTIES LABELS ${module} TIMEOUT 600)
endfunction()

# segsim_add_bench(<module> <name> <smoke filter> [library...]) builds <name>_bench.cpp likewise.
# CTest runs the cases that match the filter once, so a benchmark cannot rot.
function(segsim_add_bench module name smoke_filter)
  set(target ${module}_${name}_bench)
  segsim_find_test_source(source ${name}_bench.cpp)
  add_executable(${target} ${source} ${PROJECT_SOURCE_DIR}/tests/benchmark_main.cpp)
  target_link_libraries(${target} PRIVATE ${ARGN} segsim::core segsim::build_flags
    benchmark::benchmark)
  add_test(NAME ${module}/${name}_bench
    COMMAND ${target} --benchmark_min_time=0 --benchmark_filter=${smoke_filter})
  set_tests_properties(${module}/${name}_bench PROPERTIES LABELS "${module};bench" TIMEOUT 600
    FAIL_REGULAR_EXPRESSION "ERROR OCCURRED")
endfunction()

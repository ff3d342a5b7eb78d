# Rules that need no running program: how the code is laid out, written and included.
find_package(Python3 REQUIRED COMPONENTS Interpreter)
add_test(NAME layers
  COMMAND Python3::Interpreter ${PROJECT_SOURCE_DIR}/tools/check_layers.py ${PROJECT_SOURCE_DIR})
add_test(NAME one_definition
  COMMAND Python3::Interpreter ${PROJECT_SOURCE_DIR}/tools/check_one_definition.py ${PROJECT_SOURCE_DIR})
add_test(NAME headers COMMAND Python3::Interpreter
  ${PROJECT_SOURCE_DIR}/tools/check_headers.py ${PROJECT_SOURCE_DIR} ${CMAKE_CXX_COMPILER})
set_tests_properties(headers PROPERTIES TIMEOUT 600)

# Another version of clang-format breaks lines elsewhere, so only the one of Debian 12 is asked.
find_program(segsim_clang_format NAMES clang-format-14 clang-format)
if(segsim_clang_format)
  execute_process(COMMAND ${segsim_clang_format} --version OUTPUT_VARIABLE version)
  if(version MATCHES "version 14\\.")
    add_test(NAME format COMMAND ${PROJECT_SOURCE_DIR}/tools/check_format.sh ${segsim_clang_format})
  endif()
endif()

# The pages and the reference: what is written in Markdown and in the comments of headers.
find_package(Python3 REQUIRED COMPONENTS Interpreter)
set(segsim_check_markdown Python3::Interpreter ${PROJECT_SOURCE_DIR}/tools/check_markdown.py)
add_test(NAME links COMMAND ${segsim_check_markdown} links ${PROJECT_SOURCE_DIR})
add_test(NAME prose COMMAND ${segsim_check_markdown} prose ${PROJECT_SOURCE_DIR})
add_test(NAME markdown_checker
  COMMAND Python3::Interpreter ${PROJECT_SOURCE_DIR}/tests/tools/check_markdown_test.py)

# The site, where mkdocs and its theme are installed (Debian: mkdocs, mkdocs-material).
find_program(segsim_mkdocs mkdocs)
if(segsim_mkdocs)
  add_test(NAME site COMMAND ${segsim_mkdocs} build --strict --quiet
    --config-file ${PROJECT_SOURCE_DIR}/mkdocs.yml --site-dir ${PROJECT_BINARY_DIR}/site)
endif()

# The reference of the public headers, where Doxygen is.
find_package(Doxygen QUIET)
if(DOXYGEN_FOUND)
  configure_file(${PROJECT_SOURCE_DIR}/cmake/Doxyfile.in ${PROJECT_BINARY_DIR}/Doxyfile @ONLY)
  add_custom_target(api_reference
    COMMAND Doxygen::doxygen ${PROJECT_BINARY_DIR}/Doxyfile
    WORKING_DIRECTORY ${PROJECT_SOURCE_DIR}
    COMMENT "Writing ${PROJECT_BINARY_DIR}/api_reference/html")
  add_test(NAME api_reference COMMAND Doxygen::doxygen ${PROJECT_BINARY_DIR}/Doxyfile
    WORKING_DIRECTORY ${PROJECT_SOURCE_DIR})
endif()

# Run at every build: writes OUTPUT (a header) with the version and the commit, if they changed.
execute_process(COMMAND git describe --always --dirty --exclude=*
  WORKING_DIRECTORY ${SOURCE_DIR} OUTPUT_VARIABLE commit OUTPUT_STRIP_TRAILING_WHITESPACE
  ERROR_QUIET)
if(NOT commit)
  set(commit "no git")
endif()
set(text "#define SEGSIM_VERSION \"${VERSION} (${commit})\"\n")
if(EXISTS ${OUTPUT})
  file(READ ${OUTPUT} present)
endif()
if(NOT "${text}" STREQUAL "${present}")
  file(WRITE ${OUTPUT} "${text}")
endif()

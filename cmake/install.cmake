# What `cmake --install` puts where, and the Debian packages that CPack makes of it.
#
#   bin/segsim, segsim-main, segsim-light      component `program`: package segsim
#   share/segsim/                              what specs of the program refer to, in the tree's folders
#   lib/, include/segsim/, lib/cmake/SegSim/   component `development`: package libsegsim-dev
#
# A library is installed with its headers by segsim_install_library below; SegSimConfig.cmake finds it
# as a component, and the packages that it needs, and no others.
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)

set(segsim_cmake_folder ${CMAKE_INSTALL_LIBDIR}/cmake/SegSim)
set(segsim_include_folder ${CMAKE_INSTALL_INCLUDEDIR}/segsim)

# segsim_install_library(<name> [HEADERS <folder>...]) installs the target segsim_<name> as
# segsim::<name>, and the headers of each folder, without those of folders below it.
function(segsim_install_library name)
  cmake_parse_arguments(library "" "" "HEADERS" ${ARGN})
  set_target_properties(segsim_${name} PROPERTIES EXPORT_NAME ${name})
  target_include_directories(segsim_${name} INTERFACE
    $<INSTALL_INTERFACE:${segsim_include_folder}>)
  install(TARGETS segsim_${name} EXPORT SegSim_${name}
    ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT development)
  install(EXPORT SegSim_${name} NAMESPACE segsim:: FILE SegSim_${name}.cmake
    DESTINATION ${segsim_cmake_folder} COMPONENT development)
  foreach(folder ${library_HEADERS})
    file(GLOB headers CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/${folder}/*.h)
    # Loops on threads and vectors are made of headers of oneTBB and Highway.
    list(FILTER headers EXCLUDE REGEX "(-inl|/parallel)\\.h$")
    install(FILES ${headers} DESTINATION ${segsim_include_folder}/${folder} COMPONENT development)
  endforeach()
endfunction()

segsim_install_library(kernel_choice)
segsim_install_library(types HEADERS core)
segsim_install_library(provenance)
segsim_install_library(files)
segsim_install_library(core)
segsim_install_library(surfels HEADERS renderer renderer/scene)
segsim_install_library(ply)
segsim_install_library(surfel_files HEADERS renderer/files)
segsim_install_library(evaluation HEADERS reconstruction/evaluation)
segsim_install_library(peers HEADERS peers)

configure_package_config_file(cmake/SegSimConfig.cmake.in ${PROJECT_BINARY_DIR}/SegSimConfig.cmake
  INSTALL_DESTINATION ${segsim_cmake_folder})
write_basic_package_version_file(${PROJECT_BINARY_DIR}/SegSimConfigVersion.cmake
  COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/SegSimConfig.cmake ${PROJECT_BINARY_DIR}/SegSimConfigVersion.cmake
  DESTINATION ${segsim_cmake_folder} COMPONENT development)

install(TARGETS segsim segsim_main segsim_light
  RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR} COMPONENT program)
# Specs name weights and budgets relative to themselves, so the folders keep their places.
set(segsim_data_folder ${CMAKE_INSTALL_DATADIR}/segsim)
foreach(folder budgets class_maps engines label_maps scene_lists specs suites trials)
  install(DIRECTORY experiments/${folder} DESTINATION ${segsim_data_folder}/experiments
    COMPONENT program PATTERN "*.cpp" EXCLUDE PATTERN "*.h" EXCLUDE PATTERN internal EXCLUDE)
endforeach()
install(DIRECTORY perception/weights DESTINATION ${segsim_data_folder}/perception
  COMPONENT program)
install(FILES python/fastsegsim/peer.py python/fastsegsim/adapters.py
  DESTINATION ${segsim_data_folder}/python/fastsegsim
  COMPONENT program)
install(FILES perception/training_defaults.yaml DESTINATION ${segsim_data_folder}/perception
  COMPONENT program)
install(FILES reconstruction/training/defaults.yaml
  DESTINATION ${segsim_data_folder}/reconstruction/training COMPONENT program)
install(FILES LICENSE README.md CHANGELOG.md DESTINATION ${CMAKE_INSTALL_DOCDIR} COMPONENT program)
install(FILES LICENSE DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/libsegsim-dev COMPONENT development)

# Debian packages: `cpack -G DEB` in the build folder.
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME segsim)
set(CPACK_PACKAGE_CONTACT "Fast-SegSim <maintainers@fast-segsim.invalid>")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "${PROJECT_DESCRIPTION}")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_COMPONENTS_ALL program development)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_COMPRESSION_TYPE gzip)
set(CPACK_DEBIAN_PROGRAM_PACKAGE_NAME segsim)
set(CPACK_DEBIAN_PROGRAM_PACKAGE_SECTION science)
set(CPACK_DEBIAN_PROGRAM_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PROGRAM_PACKAGE_RECOMMENDS "libjs-chart.js, libjs-three")
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_NAME libsegsim-dev)
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_SECTION libdevel)
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_DEPENDS "libglm-dev, libhwy-dev, libtbb-dev")
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_SUGGESTS "libopenexr-dev, libssl-dev, libyaml-cpp-dev")
set(CPACK_COMPONENT_DEVELOPMENT_DESCRIPTION "Surfel rendering: libraries, headers, CMake package.")
include(CPack)

# cmake --build build/host --target package: build/host/esmc_VERSION_ARCHITECTURE.deb, the command and the library.
# Name, version, summary and home page come from project().
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME esmc)
set(CPACK_PACKAGE_VENDOR "the esmc authors")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY ${PROJECT_DESCRIPTION})
set(CPACK_PACKAGE_DESCRIPTION
"Controller and host simulation for the planar two-link arm and the five-bar
parallel mechanism under extended sliding-mode control.
.
This package holds the command esmc (simulation, hardware in the loop on a CAN
interface, emulated drives, checks of scenes), the Python module esmc, and the
controller library with headers and CMake configuration:
find_package(esmc CONFIG).")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_MAINTAINER "The esmc authors <esmc@example.org>" CACHE STRING
    "Who answers for a package that is given to others")
set(CPACK_DEBIAN_PACKAGE_SECTION science)
set(CPACK_DEBIAN_PACKAGE_PRIORITY optional)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_DEPENDS "libeigen3-dev (>= 3.4)")  # what find_package(esmc) asks for
if(TARGET esmc_python)
  string(APPEND CPACK_DEBIAN_PACKAGE_DEPENDS ", python3 (>= 3.11), python3 (<< 3.12), python3-numpy")
endif()
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)
set(CPACK_INSTALL_DEFAULT_DIRECTORY_PERMISSIONS OWNER_READ OWNER_WRITE OWNER_EXECUTE GROUP_READ GROUP_EXECUTE WORLD_READ
    WORLD_EXECUTE)
set(CPACK_PRE_BUILD_SCRIPTS ${CMAKE_CURRENT_LIST_DIR}/debian_files.cmake)
include(CPack)

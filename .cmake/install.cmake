# cmake --install: the controller library for use in somebody else's firmware, find_package(esmc CONFIG), and on the
# host the esmc command with its manual page. The version is that of project() in CMakeLists.txt, everywhere.
include(CMakePackageConfigHelpers)

install(TARGETS esmc_hal esmc_numerics esmc_firmware esmc_control EXPORT esmc_targets)
install(DIRECTORY ${PROJECT_SOURCE_DIR}/firmware DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/esmc FILES_MATCHING PATTERN "*.hpp")
file(GLOB concepts ${PROJECT_SOURCE_DIR}/hal/*.hpp)
install(FILES ${concepts} DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/esmc/hal)
install(FILES ${PROJECT_SOURCE_DIR}/hal/slcan/slcan.hpp DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/esmc/hal/slcan)
install(EXPORT esmc_targets NAMESPACE esmc:: FILE esmc-targets.cmake DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/esmc)
file(WRITE ${PROJECT_BINARY_DIR}/esmc-config.cmake "include(CMakeFindDependencyMacro)
find_dependency(Eigen3 3.4 NO_MODULE)
include(\${CMAKE_CURRENT_LIST_DIR}/esmc-targets.cmake)
")
write_basic_package_version_file(${PROJECT_BINARY_DIR}/esmc-config-version.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/esmc-config.cmake ${PROJECT_BINARY_DIR}/esmc-config-version.cmake
        DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/esmc)

if(TARGET esmc)
  install(TARGETS esmc)
  # Written when it is installed, by asking the program, so that it cannot say anything else than --help.
  set(manual ${PROJECT_BINARY_DIR}/esmc.1)
  install(CODE "execute_process(COMMAND \"${CMAKE_COMMAND}\" \"-DESMC=$<TARGET_FILE:esmc>\" \"-DOUT=${manual}\"
                                -P \"${PROJECT_SOURCE_DIR}/.cmake/manual_page.cmake\" COMMAND_ERROR_IS_FATAL ANY)")
  install(FILES ${manual} DESTINATION ${CMAKE_INSTALL_MANDIR}/man1)
  set(completion ${PROJECT_BINARY_DIR}/completion.bash)
  install(CODE "execute_process(COMMAND \"$<TARGET_FILE:esmc>\" completion bash OUTPUT_FILE \"${completion}\"
                                COMMAND_ERROR_IS_FATAL ANY)")
  install(FILES ${completion} DESTINATION ${CMAKE_INSTALL_DATAROOTDIR}/bash-completion/completions RENAME esmc)
  if(TARGET esmc_python)  # if it is built; where Debian's python3 looks, below /usr
    install(TARGETS esmc_python LIBRARY DESTINATION lib/python3/dist-packages OPTIONAL)
    install(FILES ${PROJECT_BINARY_DIR}/python/esmc.pyi DESTINATION lib/python3/dist-packages/esmc-stubs RENAME __init__.pyi)  # PEP 561
  endif()
  include(.cmake/package.cmake)
endif()

# Install + export: an installed SDK is used with find_package(rsfm).
include(CMakePackageConfigHelpers)
install(EXPORT rsfmTargets NAMESPACE rsfm:: DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/rsfm)
configure_package_config_file(${PROJECT_SOURCE_DIR}/cmake/rsfmConfig.cmake.in ${PROJECT_BINARY_DIR}/rsfmConfig.cmake
  INSTALL_DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/rsfm)
write_basic_package_version_file(${PROJECT_BINARY_DIR}/rsfmConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/rsfmConfig.cmake ${PROJECT_BINARY_DIR}/rsfmConfigVersion.cmake
  ${PROJECT_SOURCE_DIR}/cmake/FindLCM.cmake
  DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/rsfm)

# Debian packages: `cpack --config build/<preset>/CPackConfig.cmake` makes rsfm-onboard, librsfm-dev and, where the tools are
# built, rsfm-tool, for the architecture of the build.
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME rsfm)
set(CPACK_PACKAGE_CONTACT "rsfm developers <rsfm@localhost>")
set(CPACK_PACKAGE_VENDOR rsfm)
set(CPACK_PACKAGE_DIRECTORY ${PROJECT_BINARY_DIR}/packages)
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_COMPONENTS_GROUPING IGNORE)
set(CPACK_COMPONENTS_ALL dev)
if(RSFM_BUILD_ONBOARD)
  list(APPEND CPACK_COMPONENTS_ALL onboard)
endif()
if(RSFM_BUILD_TOOLS)
  list(APPEND CPACK_COMPONENTS_ALL tool)
endif()
if(RSFM_DEBIAN_ARCH)
  set(CPACK_DEBIAN_PACKAGE_ARCHITECTURE ${RSFM_DEBIAN_ARCH})
endif()
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SECTION science)
set(CPACK_DEBIAN_ONBOARD_PACKAGE_NAME rsfm-onboard)
set(CPACK_DEBIAN_TOOL_PACKAGE_NAME rsfm-tool)
set(CPACK_DEBIAN_DEV_PACKAGE_NAME librsfm-dev)
set(CPACK_DEBIAN_DEV_PACKAGE_SECTION libdevel)
set(CPACK_COMPONENT_ONBOARD_DESCRIPTION "Refractive odometry and mapping: the vehicle's daemon
 Maps what an underwater camera sees behind its glass port, publishes poses
 on LCM and writes a mission.")
set(CPACK_COMPONENT_TOOL_DESCRIPTION "Refractive odometry and mapping: the desk's program
 Checks rigs, maps, refines, evaluates and exports missions of underwater
 vehicles.")
set(CPACK_COMPONENT_DEV_DESCRIPTION "Refractive odometry and mapping: the SDK
 Headers, static libraries, LCM message types and their Java archive.")
set(CPACK_DEBIAN_ONBOARD_PACKAGE_CONTROL_EXTRA
  "${PROJECT_SOURCE_DIR}/cmake/debian/postinst;${PROJECT_SOURCE_DIR}/cmake/debian/prerm")
# What the packages need is asked of the programs when they are there: package_depends.cmake.
set(CPACK_PROJECT_CONFIG_FILE ${PROJECT_SOURCE_DIR}/cmake/package_depends.cmake)
set(CPACK_RSFM_BUILD ${PROJECT_BINARY_DIR})
set(CPACK_RSFM_SYSROOT "${CMAKE_SYSROOT}")
set(CPACK_RSFM_TRIPLET "${CMAKE_LIBRARY_ARCHITECTURE}")
include(CPack)

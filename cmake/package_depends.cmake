# Included by cpack: the packages whose libraries the programs ask for, by the package data base of the system they were built for.
include(${CMAKE_CURRENT_LIST_DIR}/shared_objects.cmake)
rsfm_depends("${CPACK_RSFM_SYSROOT}" ${CPACK_RSFM_TRIPLET} ${CPACK_RSFM_BUILD}/tools/onboard/rsfm_onboard CPACK_DEBIAN_ONBOARD_PACKAGE_DEPENDS)
rsfm_depends("${CPACK_RSFM_SYSROOT}" ${CPACK_RSFM_TRIPLET} ${CPACK_RSFM_BUILD}/tools/rsfm_tool/rsfm_tool CPACK_DEBIAN_TOOL_PACKAGE_DEPENDS)
set(CPACK_DEBIAN_DEV_PACKAGE_DEPENDS
  "libeigen3-dev, libexpected-dev, libboost-dev, libyaml-cpp-dev, libgeographiclib-dev | libgeographic-dev, libopencv-dev, liblcm-dev, libturbojpeg0-dev")

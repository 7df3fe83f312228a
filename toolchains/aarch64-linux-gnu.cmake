# 64-bit ARM: Jetson, Raspberry Pi 3 and later with a 64-bit system. Settings: sysroot.cmake
set(CMAKE_SYSTEM_PROCESSOR aarch64)
set(RSFM_TRIPLET aarch64-linux-gnu)
set(RSFM_DEBIAN_ARCH arm64)
set(RSFM_QEMU qemu-aarch64)
include(${CMAKE_CURRENT_LIST_DIR}/sysroot.cmake)

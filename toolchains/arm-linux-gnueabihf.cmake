# 32-bit ARM (v7, hard float), Debian's armhf: Raspberry Pi with a 32-bit system. Settings: sysroot.cmake
set(CMAKE_SYSTEM_PROCESSOR armv7l)
set(RSFM_TRIPLET arm-linux-gnueabihf)
set(RSFM_DEBIAN_ARCH armhf)
set(RSFM_QEMU qemu-arm)
include(${CMAKE_CURRENT_LIST_DIR}/sysroot.cmake)

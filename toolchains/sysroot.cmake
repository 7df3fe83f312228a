# What the toolchain files share: a cross GCC and a sysroot that toolchains/make_sysroot.sh made.
# In: RSFM_TRIPLET, RSFM_DEBIAN_ARCH, RSFM_QEMU. The user may set, as CMake or environment variables,
#   RSFM_SYSROOT  the sysroot; default: build/sysroot-<architecture> of this tree
#   RSFM_GCC      version suffix of the cross compiler, as 11 for aarch64-linux-gnu-g++-11; default: none
foreach(variable RSFM_SYSROOT RSFM_GCC)
  if(NOT DEFINED ${variable} AND DEFINED ENV{${variable}})
    set(${variable} $ENV{${variable}})
  endif()
endforeach()
if(NOT RSFM_SYSROOT)
  cmake_path(GET CMAKE_CURRENT_LIST_DIR PARENT_PATH root)
  set(RSFM_SYSROOT ${root}/build/sysroot-${RSFM_DEBIAN_ARCH})
endif()
if(NOT EXISTS ${RSFM_SYSROOT}/usr/include)
  message(FATAL_ERROR "no sysroot in ${RSFM_SYSROOT}: run toolchains/make_sysroot.sh --arch ${RSFM_DEBIAN_ARCH} "
    "or set RSFM_SYSROOT to where one is")
endif()
list(APPEND CMAKE_TRY_COMPILE_PLATFORM_VARIABLES RSFM_SYSROOT RSFM_GCC)

set(CMAKE_SYSTEM_NAME Linux)
set(CMAKE_SYSROOT ${RSFM_SYSROOT})
set(suffix "")
if(RSFM_GCC)
  set(suffix -${RSFM_GCC})
endif()
set(CMAKE_C_COMPILER ${RSFM_TRIPLET}-gcc${suffix})
set(CMAKE_CXX_COMPILER ${RSFM_TRIPLET}-g++${suffix})
set(CMAKE_LIBRARY_ARCHITECTURE ${RSFM_TRIPLET})
set(CMAKE_FIND_ROOT_PATH ${RSFM_SYSROOT})
set(CMAKE_FIND_ROOT_PATH_MODE_PROGRAM NEVER)  # lcm-gen and the like run here
set(CMAKE_FIND_ROOT_PATH_MODE_LIBRARY ONLY)
set(CMAKE_FIND_ROOT_PATH_MODE_INCLUDE ONLY)
set(CMAKE_FIND_ROOT_PATH_MODE_PACKAGE ONLY)
set(ENV{PKG_CONFIG_DIR} "")
set(ENV{PKG_CONFIG_SYSROOT_DIR} ${RSFM_SYSROOT})
set(ENV{PKG_CONFIG_LIBDIR} "${RSFM_SYSROOT}/usr/lib/${RSFM_TRIPLET}/pkgconfig:${RSFM_SYSROOT}/usr/share/pkgconfig")
# Where the linker finds what the libraries need themselves.
set(link_paths "-Wl,-rpath-link,${RSFM_SYSROOT}/usr/lib/${RSFM_TRIPLET}:${RSFM_SYSROOT}/lib/${RSFM_TRIPLET}")
set(CMAKE_EXE_LINKER_FLAGS_INIT ${link_paths})
set(CMAKE_SHARED_LINKER_FLAGS_INIT ${link_paths})

# Tests run under QEMU's user emulation, where it is installed.
find_program(RSFM_EMULATOR NAMES ${RSFM_QEMU} ${RSFM_QEMU}-static NO_CMAKE_FIND_ROOT_PATH)
if(RSFM_EMULATOR)
  set(CMAKE_CROSSCOMPILING_EMULATOR ${RSFM_EMULATOR} -L ${RSFM_SYSROOT})
endif()

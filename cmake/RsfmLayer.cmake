# rsfm_add_layer(NAME SOURCES … HEADERS … DEPENDS … PRIVATE_DEPENDS … [EXCEPTIONS])
#   One static library rsfm_<NAME>, alias rsfm::<NAME>, for one folder of sdk/ or drivers/.
#   Headers are included as "rsfm/<folder>/<file>.h", in the tree (through the link build/include/rsfm)
#   and once installed. EXCEPTIONS keeps -fexceptions and RTTI for layers whose third-party code throws.
file(MAKE_DIRECTORY ${PROJECT_BINARY_DIR}/include)
file(CREATE_LINK ${PROJECT_SOURCE_DIR}/sdk ${PROJECT_BINARY_DIR}/include/rsfm SYMBOLIC)
file(CREATE_LINK ${PROJECT_SOURCE_DIR}/drivers ${PROJECT_BINARY_DIR}/include/rsfm_drivers SYMBOLIC)

add_library(rsfm_warnings INTERFACE)
target_compile_options(rsfm_warnings INTERFACE
  -Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wno-sign-conversion
  $<$<CXX_COMPILER_ID:GNU>:-Wno-restrict>  # GCC 12 sees overlaps in std::string's operator+ that are none (GCC bug 105651)
  $<$<BOOL:${RSFM_WERROR}>:-Werror>)

function(rsfm_add_layer name)
  cmake_parse_arguments(ARG "EXCEPTIONS" "" "SOURCES;HEADERS;DEPENDS;PRIVATE_DEPENDS" ${ARGN})
  set(target rsfm_${name})
  add_library(${target} STATIC ${ARG_SOURCES})
  add_library(rsfm::${name} ALIAS ${target})
  set_target_properties(${target} PROPERTIES EXPORT_NAME ${name} LINKER_LANGUAGE CXX)
  target_compile_features(${target} PUBLIC cxx_std_20)
  target_include_directories(${target} PUBLIC
    $<BUILD_INTERFACE:${PROJECT_BINARY_DIR}/include> $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>)
  target_link_libraries(${target} PUBLIC ${ARG_DEPENDS} PRIVATE $<BUILD_INTERFACE:rsfm_warnings> ${ARG_PRIVATE_DEPENDS})
  if(NOT ARG_EXCEPTIONS)
    target_compile_options(${target} PRIVATE -fno-exceptions -fno-rtti)
  endif()
  set_property(GLOBAL APPEND PROPERTY RSFM_LAYER_TARGETS ${target})
  install(TARGETS ${target} EXPORT rsfmTargets ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR})
  cmake_path(RELATIVE_PATH CMAKE_CURRENT_SOURCE_DIR BASE_DIRECTORY ${PROJECT_SOURCE_DIR}/sdk OUTPUT_VARIABLE folder)
  # sdk/base is installed as rsfm/base, drivers/lcm as rsfm_drivers/lcm: as they are included in the tree.
  string(REGEX REPLACE "^rsfm/\\.\\./drivers/" "rsfm_drivers/" folder "rsfm/${folder}")
  install(FILES ${ARG_HEADERS} DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/${folder})
endfunction()

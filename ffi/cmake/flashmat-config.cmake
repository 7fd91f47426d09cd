# find_package(flashmat): targets flashmat::static and flashmat::shared (each if installed), and flashmat::flashmat for
# either, the static one first.
get_filename_component(_flashmat_prefix "${CMAKE_CURRENT_LIST_DIR}/../../.." ABSOLUTE)
set(_flashmat_static "${_flashmat_prefix}/lib/${CMAKE_STATIC_LIBRARY_PREFIX}flashmat${CMAKE_STATIC_LIBRARY_SUFFIX}")
set(_flashmat_shared "${_flashmat_prefix}/lib/${CMAKE_SHARED_LIBRARY_PREFIX}flashmat${CMAKE_SHARED_LIBRARY_SUFFIX}")

if(EXISTS "${_flashmat_static}" AND NOT TARGET flashmat::static)
  add_library(flashmat::static STATIC IMPORTED)
  set_target_properties(flashmat::static PROPERTIES
    IMPORTED_LOCATION "${_flashmat_static}"
    INTERFACE_INCLUDE_DIRECTORIES "${_flashmat_prefix}/include")
  # What Rust's standard library needs of the system.
  if(UNIX AND NOT APPLE)
    find_package(Threads REQUIRED)
    set_property(TARGET flashmat::static PROPERTY INTERFACE_LINK_LIBRARIES Threads::Threads ${CMAKE_DL_LIBS} m)
  endif()
endif()
if(EXISTS "${_flashmat_shared}" AND NOT TARGET flashmat::shared)
  add_library(flashmat::shared SHARED IMPORTED)
  set_target_properties(flashmat::shared PROPERTIES
    IMPORTED_LOCATION "${_flashmat_shared}"
    IMPORTED_NO_SONAME TRUE
    INTERFACE_INCLUDE_DIRECTORIES "${_flashmat_prefix}/include")
endif()
if(NOT TARGET flashmat::flashmat)
  add_library(flashmat::flashmat INTERFACE IMPORTED)
  if(TARGET flashmat::static)
    set_property(TARGET flashmat::flashmat PROPERTY INTERFACE_LINK_LIBRARIES flashmat::static)
  elseif(TARGET flashmat::shared)
    set_property(TARGET flashmat::flashmat PROPERTY INTERFACE_LINK_LIBRARIES flashmat::shared)
  else()
    set(flashmat_FOUND FALSE)
    set(flashmat_NOT_FOUND_MESSAGE "no libflashmat in ${_flashmat_prefix}/lib")
  endif()
endif()

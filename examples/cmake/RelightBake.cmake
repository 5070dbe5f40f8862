# relight_add_bake(NAME <target> INPUT <job.toml|.lp|folder> OUTPUT <asset> [OPTIONS <option>..] [CACHE <folder>])
#
# Adds a target that bakes INPUT to OUTPUT whenever the job file or a picture, light file or other file that the bake read has changed.
# Relative names are below the current source folder (INPUT) and binary folder (OUTPUT, CACHE). A command that uses the asset names
# both: DEPENDS <target> for the order, and the asset, whose path is the target's property RELIGHT_ASSET, for when to run again.
# RELIGHT_EXECUTABLE is the program. Generators: Ninja and Unix Makefiles. Names with # want
# CMake 3.30.

cmake_minimum_required(VERSION 3.21)

# cmake -D DEPFILE=.. -D STAMP=.. -P this file: the depfile's rule becomes the stamp's, and the stamp new.
if(CMAKE_SCRIPT_MODE_FILE STREQUAL CMAKE_CURRENT_LIST_FILE)
  file(READ "${DEPFILE}" rule)
  string(FIND "${rule}" ": \\\n" inputs)
  string(SUBSTRING "${rule}" ${inputs} -1 inputs)
  set(target "${STAMP}")
  foreach(special IN ITEMS " " "#" ":")
    string(REPLACE "${special}" "\\${special}" target "${target}")
  endforeach()
  string(REPLACE "$" "$$" target "${target}")
  file(WRITE "${DEPFILE}" "${target}${inputs}")
  file(TOUCH "${STAMP}")
  return()
endif()

find_program(RELIGHT_EXECUTABLE relight REQUIRED DOC "The relight program")

function(relight_add_bake)
  # Depfiles name files below the folder that the build runs in.
  if(POLICY CMP0116)
    cmake_policy(SET CMP0116 NEW)
  endif()
  cmake_parse_arguments(PARSE_ARGV 0 bake "" "NAME;INPUT;OUTPUT;CACHE" "OPTIONS")
  if(NOT bake_NAME OR NOT bake_INPUT OR NOT bake_OUTPUT OR bake_UNPARSED_ARGUMENTS)
    message(FATAL_ERROR "relight_add_bake(NAME .. INPUT .. OUTPUT .. [OPTIONS ..] [CACHE ..]): ${ARGV}")
  endif()
  cmake_path(ABSOLUTE_PATH bake_INPUT NORMALIZE)
  cmake_path(ABSOLUTE_PATH bake_OUTPUT BASE_DIRECTORY "${CMAKE_CURRENT_BINARY_DIR}" NORMALIZE)
  set(cache)
  if(bake_CACHE)
    cmake_path(ABSOLUTE_PATH bake_CACHE BASE_DIRECTORY "${CMAKE_CURRENT_BINARY_DIR}" NORMALIZE)
    set(cache --cache "${bake_CACHE}")
  endif()
  cmake_path(GET bake_OUTPUT PARENT_PATH folder)
  file(MAKE_DIRECTORY "${folder}")
  set(inputs "${RELIGHT_EXECUTABLE}")
  # A folder's own time says nothing: it changes with files that no bake reads. The depfile lists those that it read.
  if(NOT IS_DIRECTORY "${bake_INPUT}")
    list(APPEND inputs "${bake_INPUT}")
  endif()

  set(command "${RELIGHT_EXECUTABLE}" bake "${bake_INPUT}" -o "${bake_OUTPUT}" ${bake_OPTIONS} ${cache})
  if(CMAKE_GENERATOR MATCHES "Ninja")
    # CMake's commands are restat = 1: an asset that stays as it was ends the matter.
    set(depfile "${bake_OUTPUT}.d")
    add_custom_command(
      OUTPUT "${bake_OUTPUT}"
      COMMAND ${command} --depfile "${depfile}"
      DEPENDS ${inputs} DEPFILE "${depfile}" COMMENT "bake ${bake_OUTPUT}" VERBATIM)
    add_custom_target(${bake_NAME} ALL DEPENDS "${bake_OUTPUT}")
  else()
    # Make runs a command again while its output is older than an input, so a stamp has to be that output. The asset is no
    # BYPRODUCT: Make would take it for new whenever the stamp is.
    set(stamp "${CMAKE_CURRENT_BINARY_DIR}/${bake_NAME}.relight")
    set(depfile "${stamp}.d")
    add_custom_command(
      OUTPUT "${stamp}"
      COMMAND ${command} --depfile "${depfile}"
      COMMAND "${CMAKE_COMMAND}" -D "DEPFILE=${depfile}" -D "STAMP=${stamp}" -P "${CMAKE_CURRENT_FUNCTION_LIST_FILE}"
      DEPENDS ${inputs} DEPFILE "${depfile}" COMMENT "bake ${bake_OUTPUT}" VERBATIM)
    add_custom_target(${bake_NAME} ALL DEPENDS "${stamp}")
    set_property(TARGET ${bake_NAME} APPEND PROPERTY ADDITIONAL_CLEAN_FILES "${bake_OUTPUT}")
  endif()
  set_property(TARGET ${bake_NAME} PROPERTY RELIGHT_ASSET "${bake_OUTPUT}")
endfunction()

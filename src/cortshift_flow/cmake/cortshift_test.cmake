# How every package declares a test:
#
#   cortshift_test(NAME KIND LABEL SECONDS FILES FILE... [LIBRARIES TARGET...] [DEPENDS TARGET...] [ENVIRONMENT NAME=VALUE...] [WAITS])
#
# KIND     gmock: FILES are C++ sources; the executable NAME is linked to LIBRARIES.
#          pytest: FILES are Python; ENVIRONMENT is set for them.
#          rostest: FILES are a launch file and, for a test in C++, the sources of the executable NAME.
# LABEL    quick: no graph, a few seconds; graph: needs a ROS master; long: no graph, but slow.
# SECONDS  after which the test and all that it started are killed: far above what it takes, since others may load the machine. The
#          variable CORTSHIFT_TEST_PATIENCE multiplies it, for builds that are slow.
# DEPENDS  what must be built first.
# WAITS    of a graph: it takes less than half a core, since it waits (for a recording that plays, a peer that is silent). Of the
#          other graphs, whose nodes share the cores, one runs at a time; this one runs beside them.
#
# A test counts as two of what `ctest -jN` runs at a time, one that WAITS as one: -j5 runs two tests, and beside them one that waits.
#
# cortshift_flow exports this file, since it is the package that every other one knows.
function(cortshift_test name kind label seconds)
  cmake_parse_arguments(ARG "WAITS" "" "FILES;LIBRARIES;DEPENDS;ENVIRONMENT" ${ARGN})
  if(ARG_UNPARSED_ARGUMENTS OR NOT ARG_FILES)
    message(FATAL_ERROR "cortshift_test(${name}): no FILES, or arguments that it does not know: ${ARG_UNPARSED_ARGUMENTS}")
  endif()
  if(NOT label MATCHES "^(quick|graph|long)$" OR NOT seconds MATCHES "^[1-9][0-9]*$")
    message(FATAL_ERROR "cortshift_test(${name}): needs the label quick, graph or long and a limit in seconds, not '${label}' '${seconds}'")
  endif()
  if(kind STREQUAL "rostest" AND NOT label STREQUAL "graph")
    message(FATAL_ERROR "cortshift_test(${name}): a test with a ROS master is labelled graph, not ${label}")
  endif()
  if(ARG_WAITS AND NOT label STREQUAL "graph")
    message(FATAL_ERROR "cortshift_test(${name}): WAITS is said of graphs; all others run beside each other anyway")
  endif()

  set(entry _ctest_${PROJECT_NAME}_${kind}_${name})   # as catkin names it
  if(kind STREQUAL "gmock")
    catkin_add_gmock(${name} ${ARG_FILES})
    target_link_libraries(${name} ${ARG_LIBRARIES} ${GMOCK_MAIN_LIBRARIES})   # Debian's catkin and Noetic's name it alike
    set(entry _ctest_${PROJECT_NAME}_gtest_${name})
    set(built ${name})
  elseif(kind STREQUAL "pytest")
    string(REPLACE ";" " " files "${ARG_FILES}")
    string(REPLACE ";" " " environment "${ARG_ENVIRONMENT}")
    set(results ${CATKIN_TEST_RESULTS_DIR}/${PROJECT_NAME}/pytest-${name}.xml)
    catkin_run_tests_target("pytest" ${name} "pytest-${name}.xml"
      COMMAND "env ${environment} ${PYTHON_EXECUTABLE} -m pytest -q -p no:cacheprovider --junit-xml=${results} ${files}"
      DEPENDENCIES ${ARG_DEPENDS}
      WORKING_DIRECTORY ${CMAKE_CURRENT_SOURCE_DIR})
    set(built tests)
  elseif(kind STREQUAL "rostest")
    list(GET ARG_FILES 0 launch)
    list(REMOVE_AT ARG_FILES 0)
    set(built tests)
    if(ARG_FILES)
      add_rostest_gtest(${name} ${launch} ${ARG_FILES})
      target_link_libraries(${name} ${ARG_LIBRARIES})
      set(built ${name})
    else()
      add_rostest(${launch} DEPENDENCIES ${ARG_DEPENDS})
    endif()
    string(REPLACE "/" "_" launch ${launch})
    set(entry _ctest_${PROJECT_NAME}_rostest_${launch})
  else()
    message(FATAL_ERROR "cortshift_test(${name}): kind '${kind}' is none of gmock, pytest, rostest")
  endif()
  if(ARG_DEPENDS)
    add_dependencies(${built} ${ARG_DEPENDS})
  endif()
  if(CORTSHIFT_TEST_PATIENCE)
    math(EXPR seconds "${seconds} * ${CORTSHIFT_TEST_PATIENCE}")
  endif()
  set_tests_properties(${entry} PROPERTIES LABELS ${label} TIMEOUT ${seconds})
  # The graphs that run one at a time come first, so that nobody waits for them at the end; what is short fills the gaps.
  if(ARG_WAITS)
    set_tests_properties(${entry} PROPERTIES COST 2)
  elseif(label STREQUAL "graph")
    set_tests_properties(${entry} PROPERTIES PROCESSORS 2 COST 4 RESOURCE_LOCK graph)
  elseif(label STREQUAL "long")
    set_tests_properties(${entry} PROPERTIES PROCESSORS 2 COST 3)
  else()
    set_tests_properties(${entry} PROPERTIES PROCESSORS 2 COST 1)
  endif()
endfunction()

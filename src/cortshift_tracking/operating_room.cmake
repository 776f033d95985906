# The operating room: console, checks before a case, recording, several machines; and their tests.
catkin_install_python(PROGRAMS scripts/case_recorder scripts/console scripts/preflight
  DESTINATION ${CATKIN_PACKAGE_BIN_DESTINATION})
if(CATKIN_ENABLE_TESTING)
  find_package(rostest REQUIRED)
  foreach(test console/console graph/pose_discipline theatre/recorder graph/tracker_faults)
    add_rostest(test/${test}.test DEPENDENCIES shift_tracker field_error)
  endforeach()
  catkin_run_tests_target("pytest" operating_room "pytest-operating_room.xml"
    COMMAND "${PYTHON_EXECUTABLE} -m pytest -q -p no:cacheprovider --junit-xml=${CATKIN_TEST_RESULTS_DIR}/${PROJECT_NAME}/pytest-operating_room.xml test/theatre/preflight_test.py test/console/console_state_test.py"
    WORKING_DIRECTORY ${CMAKE_CURRENT_SOURCE_DIR})
endif()

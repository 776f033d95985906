# The operating room: console, checks before a case, recording, several machines; and their tests.
catkin_install_python(PROGRAMS scripts/case_recorder scripts/console scripts/preflight
  DESTINATION ${CATKIN_PACKAGE_BIN_DESTINATION})
if(CATKIN_ENABLE_TESTING)
  find_package(rostest REQUIRED)
  foreach(test console/console graph/pose_discipline theatre/recorder graph/tracker_faults)
    get_filename_component(name ${test}_test NAME)
    cortshift_test(${name} rostest graph 900 FILES test/${test}.test DEPENDS shift_tracker field_error)
  endforeach()
  cortshift_test(preflight_test pytest quick 300 FILES test/theatre/preflight_test.py)
  cortshift_test(console_state_test pytest quick 300 FILES test/console/console_state_test.py)
endif()

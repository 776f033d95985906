# The operating room: console, checks before a case, several machines; and their tests.
catkin_install_python(PROGRAMS scripts/console DESTINATION ${CATKIN_PACKAGE_BIN_DESTINATION})
if(CATKIN_ENABLE_TESTING)
  find_package(rostest REQUIRED)
  add_rostest(test/console.test DEPENDENCIES shift_tracker)
endif()

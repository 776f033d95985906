# The operating room: console, checks before a case, recording, several machines; and their tests.
add_library(${PROJECT_NAME}_recording
  src/ros/recording/held_messages.cpp
  src/ros/recording/part_recorder.cpp
  src/ros/recording/sequence_watch.cpp)
target_link_libraries(${PROJECT_NAME}_recording ${catkin_LIBRARIES})
target_include_directories(${PROJECT_NAME}_recording PUBLIC include SYSTEM PUBLIC ${catkin_INCLUDE_DIRS})
add_executable(record_parts src/nodes/record_parts_node.cpp)
target_link_libraries(record_parts ${PROJECT_NAME}_recording)
install(TARGETS ${PROJECT_NAME}_recording record_parts
  LIBRARY DESTINATION ${CATKIN_PACKAGE_LIB_DESTINATION} RUNTIME DESTINATION ${CATKIN_PACKAGE_BIN_DESTINATION})

catkin_install_python(PROGRAMS scripts/case_recorder scripts/console scripts/preflight
  DESTINATION ${CATKIN_PACKAGE_BIN_DESTINATION})
if(CATKIN_ENABLE_TESTING)
  find_package(rostest REQUIRED)
  catkin_add_gmock(recording_test test/ros/recording/recording_test.cpp)
  target_link_libraries(recording_test ${PROJECT_NAME}_recording ${GMOCK_MAIN_LIBRARIES})
  foreach(test console/console graph/pose_discipline theatre/recorder graph/tracker_faults)
    add_rostest(test/${test}.test DEPENDENCIES shift_tracker field_error record_parts)
  endforeach()
  catkin_run_tests_target("pytest" operating_room "pytest-operating_room.xml"
    COMMAND "${PYTHON_EXECUTABLE} -m pytest -q -p no:cacheprovider --junit-xml=${CATKIN_TEST_RESULTS_DIR}/${PROJECT_NAME}/pytest-operating_room.xml test/theatre/preflight_test.py test/console/console_state_test.py"
    WORKING_DIRECTORY ${CMAKE_CURRENT_SOURCE_DIR})
endif()

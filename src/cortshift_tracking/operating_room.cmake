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

catkin_install_python(PROGRAMS scripts/case_recorder scripts/console scripts/master_keeper scripts/play_case scripts/preflight
  DESTINATION ${CATKIN_PACKAGE_BIN_DESTINATION})
# How others call the services (doc/calling.md).
add_executable(first_shift examples/first_shift.cpp)
target_include_directories(first_shift SYSTEM PRIVATE ${catkin_INCLUDE_DIRS})
target_link_libraries(first_shift ${catkin_LIBRARIES})
add_dependencies(first_shift ${catkin_EXPORTED_TARGETS})
install(TARGETS first_shift RUNTIME DESTINATION ${CATKIN_PACKAGE_BIN_DESTINATION})
catkin_install_python(PROGRAMS examples/first_shift.py DESTINATION ${CATKIN_PACKAGE_BIN_DESTINATION})

if(CATKIN_ENABLE_TESTING)
  find_package(rostest REQUIRED)
  cortshift_test(recording_test gmock quick 60 FILES test/ros/recording/recording_test.cpp LIBRARIES ${PROJECT_NAME}_recording)
  cortshift_test(recorder_test rostest graph 900 FILES test/theatre/recorder.test DEPENDS record_parts WAITS)
  foreach(test console/console graph/pose_discipline graph/tracker_faults theatre/any_node_dies theatre/launched)
    get_filename_component(name ${test}_test NAME)
    cortshift_test(${name} rostest graph 900 FILES test/${test}.test DEPENDS shift_tracker field_error record_parts igtl_bridge)
  endforeach()
  cortshift_test(soak_test pytest graph 900 FILES test/theatre/soak_test.py
    DEPENDS shift_tracker record_parts igtl_bridge)
  cortshift_test(master_keeper_test pytest graph 300 FILES test/theatre/master_keeper_test.py)
  cortshift_test(preflight_test pytest long 300 FILES test/theatre/preflight_test.py)
  foreach(test console_state page)
    cortshift_test(${test}_test pytest quick 300 FILES test/console/${test}_test.py)
  endforeach()
endif()

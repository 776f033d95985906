# Recorded cases without a master: library, tools and their tests.
# Python: exports and cohorts; the modules are named in setup.py.
catkin_install_python(PROGRAMS scripts/cohort/cohort_case scripts/cohort/cohort_table scripts/export_field DESTINATION ${CATKIN_PACKAGE_BIN_DESTINATION})
install(PROGRAMS scripts/cohort/slurm_job_status DESTINATION ${CATKIN_PACKAGE_BIN_DESTINATION})

find_package(BZip2 REQUIRED)
add_library(${PROJECT_NAME}_offline
  src/offline/bag/bag_file.cpp
  src/offline/bag/bag_format.cpp
  src/offline/bag/bag_index.cpp
  src/offline/bag/bag_records.cpp
  src/offline/case_capture.cpp
  src/offline/case_check.cpp
  src/offline/case_output.cpp
  src/offline/case_plan.cpp
  src/offline/case_recording.cpp
  src/offline/offline_parameters.cpp
  src/offline/recomputation.cpp
  src/offline/tool_options.cpp)
target_include_directories(${PROJECT_NAME}_offline PRIVATE src)
target_link_libraries(${PROJECT_NAME}_offline ${PROJECT_NAME}_ros cortshift_stereo_command_line ${catkin_LIBRARIES} BZip2::BZip2)
foreach(tool process_bag recompute validate_bag)
  add_executable(${tool} tools/${tool}.cpp)
  target_link_libraries(${tool} ${PROJECT_NAME}_offline)
  install(TARGETS ${tool} RUNTIME DESTINATION ${CATKIN_PACKAGE_BIN_DESTINATION})
endforeach()
install(TARGETS ${PROJECT_NAME}_offline LIBRARY DESTINATION ${CATKIN_PACKAGE_LIB_DESTINATION})

if(CATKIN_ENABLE_TESTING)
  cortshift_test(bag_file_test gmock quick 300 FILES test/offline/bag/bag_file_test.cpp LIBRARIES ${PROJECT_NAME}_offline)

  find_package(rostest REQUIRED)
  foreach(test mean replay)
    cortshift_test(process_bag_${test}_test rostest graph 900 FILES test/offline/process_bag_${test}.test
      DEPENDS process_bag shift_tracker)
  endforeach()
  # Faults in the shipped recording: each kind by name, and at random; and which calibration counts.
  foreach(test admission calibration_in_force fault_property)
    cortshift_test(bag_${test}_test pytest long 1200 FILES test/offline/${test}_test.py DEPENDS process_bag validate_bag)
  endforeach()
  foreach(test cohort export offline)
    cortshift_test(${test}_test pytest long 1200 FILES test/${test}/${test}_test.py DEPENDS process_bag recompute validate_bag)
  endforeach()
endif()

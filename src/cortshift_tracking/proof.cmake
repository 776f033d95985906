# Python of this package: probe, preoperative MR, validation, report; and its tests.
catkin_python_setup()
catkin_install_python(PROGRAMS scripts/case_report scripts/digital_phantom scripts/probe scripts/register_mr DESTINATION ${CATKIN_PACKAGE_BIN_DESTINATION})
if(CATKIN_ENABLE_TESTING)
  find_package(rostest REQUIRED)
  set(PROOF_TESTS mr/mr mr/dicom mr/admission mr/cross_section digital_phantom probe/probe report/validation report/left_out report/report mr/phantom_mr)
  list(TRANSFORM PROOF_TESTS REPLACE "(.+)" "test/\\1_test.py")
  list(JOIN PROOF_TESTS " " PROOF_TESTS)
  catkin_run_tests_target("pytest" proof "pytest-proof.xml"
    COMMAND "${PYTHON_EXECUTABLE} -m pytest -q -p no:cacheprovider --junit-xml=${CATKIN_TEST_RESULTS_DIR}/${PROJECT_NAME}/pytest-proof.xml ${PROOF_TESTS}"
    WORKING_DIRECTORY ${CMAKE_CURRENT_SOURCE_DIR})
  # The order of the house: who includes whom, sizes, names, and that each test is run by what CMake wrote.
  catkin_run_tests_target("pytest" house "pytest-house.xml"
    COMMAND "env CORTSHIFT_BUILD=${CMAKE_BINARY_DIR} ${PYTHON_EXECUTABLE} -m pytest -q -p no:cacheprovider --junit-xml=${CATKIN_TEST_RESULTS_DIR}/${PROJECT_NAME}/pytest-house.xml test/house_test.py"
    WORKING_DIRECTORY ${CMAKE_CURRENT_SOURCE_DIR})
  add_rostest(test/probe/probe_node.test)
  add_rostest(test/graph/demo_case.test DEPENDENCIES shift_tracker field_error)
endif()

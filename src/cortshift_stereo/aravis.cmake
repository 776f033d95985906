# Cameras through Aravis.
find_package(PkgConfig REQUIRED)
# Ubuntu 20.04 has Aravis 0.6, whose interface is another one: install 0.8 there.
pkg_check_modules(ARAVIS REQUIRED IMPORTED_TARGET aravis-0.8)
target_sources(${PROJECT_NAME}_sources PRIVATE
  src/sources/aravis/aravis_camera.cpp
  src/sources/aravis/aravis_source.cpp
  src/sources/aravis/clock_map.cpp
  src/sources/aravis/pixel_formats.cpp)
target_link_libraries(${PROJECT_NAME}_sources PkgConfig::ARAVIS)

if(CATKIN_ENABLE_TESTING)
  cortshift_test(sources_test gmock quick 300 FILES test/sources/sources_test.cpp LIBRARIES ${PROJECT_NAME}_sources)
  target_include_directories(sources_test PRIVATE src)

  # A GigE Vision camera in software whose images say when they were exposed.
  add_executable(fake_gige_camera EXCLUDE_FROM_ALL test/support/fake_gige_camera.cpp)
  target_link_libraries(fake_gige_camera PkgConfig::ARAVIS)
  cortshift_test(aravis_test rostest graph 900 FILES test/sources/aravis.test DEPENDS stereo_driver_node fake_gige_camera)
endif()

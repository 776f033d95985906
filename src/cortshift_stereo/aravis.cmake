# Cameras through Aravis 0.8. Where there is none (Ubuntu 20.04 has 0.6, whose interface is another one) that source alone is
# missing, and says so when it is asked for.
find_package(PkgConfig REQUIRED)
pkg_check_modules(ARAVIS QUIET IMPORTED_TARGET aravis-0.8)
target_sources(${PROJECT_NAME}_sources PRIVATE
  src/sources/aravis/aravis_source.cpp
  src/sources/aravis/clock_map.cpp
  src/sources/aravis/pixel_formats.cpp)
if(ARAVIS_FOUND)
  target_sources(${PROJECT_NAME}_sources PRIVATE src/sources/aravis/aravis_camera.cpp)
  target_link_libraries(${PROJECT_NAME}_sources PkgConfig::ARAVIS)
else()
  message(STATUS "aravis-0.8 is not found: the source 'aravis' is left out")
  target_sources(${PROJECT_NAME}_sources PRIVATE src/sources/aravis/no_aravis_camera.cpp)
endif()

if(CATKIN_ENABLE_TESTING)
  cortshift_test(sources_test gmock quick 300 FILES test/sources/phantom_source_test.cpp test/sources/sources_test.cpp
    LIBRARIES ${PROJECT_NAME}_sources)
  target_include_directories(sources_test PRIVATE src)
  cortshift_test(no_aravis_test gmock quick 60 FILES test/sources/no_aravis_test.cpp src/sources/aravis/no_aravis_camera.cpp
    LIBRARIES ${PROJECT_NAME})
  target_include_directories(no_aravis_test PRIVATE include src)
endif()

if(CATKIN_ENABLE_TESTING AND ARAVIS_FOUND)
  # A GigE Vision camera in software whose images say when they were exposed.
  add_executable(fake_gige_camera EXCLUDE_FROM_ALL test/support/fake_gige_camera.cpp)
  target_link_libraries(fake_gige_camera PkgConfig::ARAVIS)
  cortshift_test(aravis_test rostest graph 900 FILES test/sources/aravis.test DEPENDS stereo_driver_node fake_gige_camera)
endif()

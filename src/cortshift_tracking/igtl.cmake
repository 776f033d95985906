# OpenIGTLink bridge: without the USE_FILE, which would take vectorisation and warnings away from the whole package.
find_package(OpenIGTLink REQUIRED)

# Core: no ROS.
set(igtl_sources
  src/igtl/compose.cpp
  src/igtl/connection.cpp
  src/igtl/endpoint.cpp
  src/igtl/mesh.cpp
  src/igtl/outbox.cpp
  src/igtl/request.cpp
  src/igtl/sockets.cpp
  src/igtl/space.cpp
  src/igtl/tool_board.cpp
  src/igtl/vtk_file.cpp
  src/igtl/wire.cpp)
add_library(${PROJECT_NAME}_igtl ${igtl_sources})
target_include_directories(${PROJECT_NAME}_igtl
  PUBLIC include PRIVATE src SYSTEM PUBLIC ${EIGEN3_INCLUDE_DIRS} PRIVATE ${cortshift_flow_INCLUDE_DIRS} ${cortshift_stereo_INCLUDE_DIRS} ${OpenIGTLink_INCLUDE_DIRS})
target_link_libraries(${PROJECT_NAME}_igtl cortshift_stereo ${OpenIGTLink_LIBRARIES} pthread)

add_library(${PROJECT_NAME}_igtl_ros
  src/ros/bridge/bridge.cpp
  src/ros/bridge/bridge_parameters.cpp
  src/ros/bridge/graph_sender.cpp
  src/ros/bridge/igtl_conversion.cpp
  src/ros/bridge/request_worker.cpp)
target_include_directories(${PROJECT_NAME}_igtl_ros PUBLIC include SYSTEM PUBLIC ${catkin_INCLUDE_DIRS})
target_link_libraries(${PROJECT_NAME}_igtl_ros ${PROJECT_NAME}_igtl ${PROJECT_NAME}_ros ${catkin_LIBRARIES})
add_dependencies(${PROJECT_NAME}_igtl_ros ${catkin_EXPORTED_TARGETS})

add_executable(igtl_bridge src/nodes/igtl_bridge_node.cpp)
target_link_libraries(igtl_bridge ${PROJECT_NAME}_igtl_ros)
install(TARGETS ${PROJECT_NAME}_igtl ${PROJECT_NAME}_igtl_ros igtl_bridge
  LIBRARY DESTINATION ${CATKIN_PACKAGE_LIB_DESTINATION} RUNTIME DESTINATION ${CATKIN_PACKAGE_BIN_DESTINATION})

if(CATKIN_ENABLE_TESTING)
  cortshift_test(igtl_test gmock quick 300 LIBRARIES ${PROJECT_NAME}_igtl FILES
    test/igtl/endpoint_test.cpp test/igtl/mesh_test.cpp test/igtl/request_test.cpp test/igtl/space_test.cpp
    test/igtl/tool_board_test.cpp test/igtl/wire_test.cpp)
  target_include_directories(igtl_test PRIVATE SYSTEM ${OpenIGTLink_INCLUDE_DIRS})

  # Hostile bytes, once more with every memory access watched (which the sanitizer of races cannot be together with).
  if(NOT CMAKE_CXX_FLAGS MATCHES "-fsanitize=thread")
    cortshift_test(igtl_fuzz_test gmock quick 300 FILES test/igtl/fuzz_test.cpp ${igtl_sources}
      LIBRARIES cortshift_stereo ${OpenIGTLink_LIBRARIES} -fsanitize=address,undefined pthread)
    target_include_directories(igtl_fuzz_test
      PRIVATE include src SYSTEM ${EIGEN3_INCLUDE_DIRS} ${cortshift_flow_INCLUDE_DIRS} ${cortshift_stereo_INCLUDE_DIRS} ${OpenIGTLink_INCLUDE_DIRS})
    target_compile_options(igtl_fuzz_test PRIVATE -fsanitize=address,undefined -fno-sanitize-recover=all)
  endif()

  foreach(test field tools peers)
    cortshift_test(igtl_${test}_test rostest graph 900 FILES test/igtl/igtl_${test}.test DEPENDS igtl_bridge WAITS)
  endforeach()
endif()

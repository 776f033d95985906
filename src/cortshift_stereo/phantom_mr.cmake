# The phantom's synthetic MR, its exact surfaces and the truth behind points, as tools.
target_sources(${PROJECT_NAME}_phantom PRIVATE phantom/src/phantom_mr.cpp)
foreach(tool phantom_mr phantom_surface phantom_truth)
  add_executable(${tool} tools/${tool}.cpp)
  target_link_libraries(${tool} ${PROJECT_NAME}_phantom)
endforeach()

# What an operator touches, from the top of the project: in an install space it lies in this package's folder of share/, in the same
# order, so that launch files and scripts find each other there as they do here.
set(top ${CMAKE_CURRENT_SOURCE_DIR}/../..)
set(share ${CATKIN_PACKAGE_SHARE_DESTINATION})
install(DIRECTORY ${top}/config ${top}/doc ${top}/launch ${top}/workflow DESTINATION ${share})
install(FILES ${top}/README.md ${top}/CHANGELOG.md ${top}/LICENSE DESTINATION ${share})
install(FILES ${top}/script/environment DESTINATION ${share}/script)
install(PROGRAMS ${top}/script/absolute_path ${top}/script/cohort ${top}/script/deidentify ${top}/script/machine ${top}/script/preflight
  ${top}/script/supervise DESTINATION ${share}/script)
install(DIRECTORY phantom/include/${PROJECT_NAME}_phantom/ DESTINATION ${CATKIN_GLOBAL_INCLUDE_DESTINATION}/${PROJECT_NAME}_phantom)

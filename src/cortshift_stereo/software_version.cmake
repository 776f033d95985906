# Run at each build: writes OUT with `git describe` of SOURCE, only when that has changed.
find_package(Git QUIET)
set(version "${FALLBACK}")
if(GIT_FOUND)
  execute_process(COMMAND ${GIT_EXECUTABLE} describe --always --tags --dirty WORKING_DIRECTORY ${SOURCE}
    OUTPUT_VARIABLE described OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET RESULT_VARIABLE failed)
  if(NOT failed)
    set(version "${described}")
  endif()
endif()
file(WRITE ${OUT}.new "#include \"cortshift_stereo/provenance.hpp\"\n\n"
  "std::string cortshift_stereo::softwareVersion() { return \"${version}\"; }\n")
execute_process(COMMAND ${CMAKE_COMMAND} -E copy_if_different ${OUT}.new ${OUT})

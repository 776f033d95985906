// The table of checks for the documentation.
#include <cstdio>

#include "cortshift_stereo/admission/checks.hpp"
#include "cortshift_stereo/command_line.hpp"

int main(int argc, char** argv) {
  return cortshift_stereo::runTool(
      argc, argv, "list_checks\n\nPrint every check of what comes in as the Markdown of doc/checks.md.\n", {},
      [](const cortshift_stereo::Options&) { std::fputs(cortshift_stereo::checksAsMarkdown().c_str(), stdout); });
}

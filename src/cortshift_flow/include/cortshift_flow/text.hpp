#pragma once

#include <cstdarg>
#include <cstdio>
#include <string>

namespace cortshift_flow {

/// As std::printf, into a text of at most 255 characters; the compiler checks the arguments.
[[gnu::format(printf, 1, 2)]] inline std::string formatted(const char* format, ...) {
  char out[256];
  std::va_list arguments;
  va_start(arguments, format);
  std::vsnprintf(out, sizeof out, format, arguments);
  va_end(arguments);
  return out;
}

/// Three significant digits: what a person reads in a message.
inline std::string shortNumber(double value) { return formatted("%.3g", value); }

}  // namespace cortshift_flow

// What a result was made with.
#pragma once

#include <string>

namespace cortshift_stereo {

/// `git describe` of the source that was built; without git the version of the package.
std::string softwareVersion();

/// SHA-256 (FIPS 180-4) of some bytes, as 64 hexadecimal digits.
std::string sha256(const std::string& bytes);

}  // namespace cortshift_stereo

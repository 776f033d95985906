// Matrices are left to one thread in every program that links this library; see the source for the reason.
#pragma once

#include <optional>

namespace cortshift_stereo {

/// How many threads OpenBLAS would use; nothing where another LAPACK is installed.
std::optional<int> threadsForMatrices();

}  // namespace cortshift_stereo

// The matrices that OpenCV hands to LAPACK here have some dozens of rows. OpenBLAS, if it is the LAPACK in use, gives
// even those to several threads that spin until the last one is done: beside other work on the same cores a calibration
// took 30 times as long.
#include "cortshift_stereo/small_matrices.hpp"

// Of OpenBLAS; not there with another LAPACK.
extern "C" {
void openblas_set_num_threads(int count) __attribute__((weak));
int openblas_get_num_threads() __attribute__((weak));
}

namespace cortshift_stereo {
namespace {

const struct AtStart {
  AtStart() {
    if (openblas_set_num_threads != nullptr) openblas_set_num_threads(1);
  }
} kAtStart;

}  // namespace

std::optional<int> threadsForMatrices() {
  if (openblas_get_num_threads == nullptr) return std::nullopt;
  return openblas_get_num_threads();
}

}  // namespace cortshift_stereo

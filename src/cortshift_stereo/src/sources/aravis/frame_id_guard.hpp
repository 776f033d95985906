// Frame numbers of two cameras that are exposed together: their difference stays.
#pragma once

#include <cstdint>
#include <limits>
#include <optional>

namespace cortshift_stereo {

/// Accepts a pair only while the difference of the two frame numbers is what it was. After a change (a trigger that one
/// camera missed, a restart) pairs are held back until the new difference has been seen `changed` times in a row, and
/// after reset() until a difference has been seen `first` times in a row.
/// GigE Vision numbers with 16 bit run 1 ... 65535: differences are taken modulo 65535, which suits wider ones, too.
class FrameIdGuard {
 public:
  static constexpr int kNever = std::numeric_limits<int>::max();

  FrameIdGuard(int first, int changed) : first_(first), changed_(changed) {}

  bool accept(std::uint64_t left, std::uint64_t right) {
    const std::uint64_t difference = (left % kPeriod + kPeriod - right % kPeriod) % kPeriod;
    seen_ = candidate_ == difference ? seen_ + 1 : 1;
    candidate_ = difference;
    if (seen_ >= (established_ ? changed_ : first_)) established_ = candidate_;
    return established_ == difference;
  }

  /// Forgets: the next difference is as good as any.
  void reset() {
    established_.reset();
    candidate_.reset();
    seen_ = 0;
  }

 private:
  static constexpr std::uint64_t kPeriod = 65535;
  int first_, changed_;
  int seen_ = 0;
  std::optional<std::uint64_t> established_, candidate_;
};

}  // namespace cortshift_stereo

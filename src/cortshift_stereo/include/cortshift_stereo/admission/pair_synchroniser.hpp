// Left and right images that belong together, and those that have no partner.
#pragma once

#include <cstdint>
#include <cstdlib>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace cortshift_stereo {

/// Pairs images by their stamps. The same image may come twice (raw and compressed): the second is ignored.
/// Stamps in nanoseconds; `now` is any steady clock [s]. Not synchronised.
template <typename Image>
class PairSynchroniser {
 public:
  enum class Side { kLeft = 0, kRight = 1 };
  struct Pair {
    int64_t stamp_ns;  ///< of the left image
    Image left;
    Image right;
  };
  struct Unpaired {
    Side side;
    int64_t stamp_ns;
    std::optional<int64_t> nearest_gap_ns;  ///< stamp of the nearest image of the other side minus its own
    int64_t tolerance_ns = 0;

    /// A sentence about what is missing.
    std::string message() const {
      const char* own = side == Side::kLeft ? "left" : "right";
      const char* other = side == Side::kLeft ? "right" : "left";
      std::string text = std::string("The ") + own + " image has no " + other + " one with its stamp";
      constexpr int64_t kOneExposure = 5000000;  // [ns] two pairs are further apart
      const bool close = nearest_gap_ns && std::abs(*nearest_gap_ns) <= kOneExposure;
      text += nearest_gap_ns
                  ? ": the nearest is " + std::to_string(1e-6 * static_cast<double>(*nearest_gap_ns)) +
                        " ms after it, sync_tolerance is " + std::to_string(1e-6 * static_cast<double>(tolerance_ns)) +
                        " ms; synchronise the cameras' trigger and stamps" +
                        (close ? ", or set sync_tolerance if the two are of one exposure." : ".")
                  : std::string("; no ") + other + " image came at all: check that camera and its topic.";
      return text;
    }
  };

  /// @param tolerance_ns  largest difference of the two stamps; 0: they are the same
  /// @param patience      [s] how long an image waits for its partner
  PairSynchroniser(int64_t tolerance_ns, double patience) : tolerance_ns_(tolerance_ns), patience_(patience) {}

  std::optional<Pair> add(Side side, int64_t stamp_ns, Image image, double now) {
    Waiting& own = waiting_[index(side)];
    Waiting& other = waiting_[1 - index(side)];
    if (paired_[index(side)].count(stamp_ns) != 0 || own.count(stamp_ns) != 0) return std::nullopt;
    const std::optional<int64_t> partner = nearest(stamp_ns, other);
    if (!partner || std::abs(*partner - stamp_ns) > tolerance_ns_) {
      own.emplace(stamp_ns, Entry{std::move(image), now});
      return std::nullopt;
    }
    Image found = std::move(other.at(*partner).image);
    other.erase(*partner);
    paired_[index(side)][stamp_ns] = now;
    paired_[1 - index(side)][*partner] = now;
    // Images come in order: what is older than a pair waits in vain.
    for (const Side s : {Side::kLeft, Side::kRight}) {
      Waiting& waiting = waiting_[index(s)];
      while (!waiting.empty() && waiting.begin()->first < std::min(stamp_ns, *partner)) giveUp(s, waiting.begin());
    }
    if (side == Side::kLeft) return Pair{stamp_ns, std::move(image), std::move(found)};
    return Pair{*partner, std::move(found), std::move(image)};
  }

  /// Images that have no partner, as far as this is known at `now`; each is reported once.
  std::vector<Unpaired> takeUnpaired(double now) {
    for (const Side side : {Side::kLeft, Side::kRight}) {
      Waiting& waiting = waiting_[index(side)];
      for (auto it = waiting.begin(); it != waiting.end();) {
        const auto next = std::next(it);
        if (now - it->second.arrival > patience_) giveUp(side, it);
        it = next;
      }
      std::map<int64_t, double>& paired = paired_[index(side)];
      for (auto it = paired.begin(); it != paired.end();) it = now - it->second > patience_ ? paired.erase(it) : ++it;
    }
    return std::exchange(unpaired_, {});
  }

 private:
  struct Entry {
    Image image;
    double arrival;
  };
  using Waiting = std::map<int64_t, Entry>;

  static std::size_t index(Side side) { return static_cast<std::size_t>(side); }

  template <typename Value>
  static std::optional<int64_t> nearest(int64_t stamp_ns, const std::map<int64_t, Value>& stamps) {
    if (stamps.empty()) return std::nullopt;
    const auto after = stamps.lower_bound(stamp_ns);
    if (after == stamps.end()) return std::prev(after)->first;
    if (after == stamps.begin()) return after->first;
    const int64_t before = std::prev(after)->first;
    return stamp_ns - before < after->first - stamp_ns ? before : after->first;
  }

  void giveUp(Side side, typename Waiting::iterator image) {
    const int64_t stamp = image->first;
    std::optional<int64_t> gap;
    const std::size_t other = 1 - index(side);
    for (const auto& candidate : {nearest(stamp, waiting_[other]), nearest(stamp, paired_[other])})
      if (candidate && (!gap || std::abs(*candidate - stamp) < std::abs(*gap))) gap = *candidate - stamp;
    if (!gap && last_given_up_[other]) gap = *last_given_up_[other] - stamp;
    last_given_up_[index(side)] = stamp;
    unpaired_.push_back({side, stamp, gap, tolerance_ns_});
    waiting_[index(side)].erase(image);
  }

  int64_t tolerance_ns_;
  double patience_;
  Waiting waiting_[2];
  std::map<int64_t, double> paired_[2];  // stamp to when it was paired
  std::optional<int64_t> last_given_up_[2];
  std::vector<Unpaired> unpaired_;
};

}  // namespace cortshift_stereo

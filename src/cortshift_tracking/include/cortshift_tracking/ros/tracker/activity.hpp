// What a node did last and what it refused, for diagnostics.
#pragma once

#include <mutex>
#include <string>

namespace cortshift_tracking {

/// Thread-safe.
class Activity {
 public:
  struct Report {
    std::string last_shift, last_refusal;
    unsigned long tracked = 0;  ///< fields of the live mode
  };

  void computed(const std::string& shift) {
    const std::lock_guard<std::mutex> guard(mutex_);
    report_.last_shift = shift;
  }
  void tracked(const std::string& shift) {
    const std::lock_guard<std::mutex> guard(mutex_);
    report_.last_shift = shift;
    ++report_.tracked;
  }
  void refused(const std::string& why) {
    const std::lock_guard<std::mutex> guard(mutex_);
    report_.last_refusal = why;
  }
  Report report() const {
    const std::lock_guard<std::mutex> guard(mutex_);
    return report_;
  }

 private:
  mutable std::mutex mutex_;
  Report report_;
};

}  // namespace cortshift_tracking

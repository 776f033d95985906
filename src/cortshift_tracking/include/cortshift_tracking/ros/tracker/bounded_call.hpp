// Calls of another node that may never answer.
#pragma once

#include <ros/service_client.h>

#include <chrono>
#include <cstdio>
#include <future>
#include <memory>
#include <mutex>
#include <string>
#include <thread>

#include "cortshift_tracking/error.hpp"

namespace cortshift_tracking {

using Deadline = std::chrono::steady_clock::time_point;

inline Deadline deadlineAfter(double seconds) {
  return std::chrono::steady_clock::now() +
         std::chrono::duration_cast<std::chrono::steady_clock::duration>(std::chrono::duration<double>(seconds));
}

/// "1.5 s"
inline std::string secondsText(double seconds) {
  char text[32];
  std::snprintf(text, sizeof text, "%.1f s", seconds);
  return text;
}

/// Each caller waits to a deadline of his own. What hangs is left behind on a thread of its own, one at most: as long
/// as a call is not answered, another is refused. Thread-safe.
template <typename Service>
class BoundedCall {
 public:
  struct Call {
    enum class Outcome {
      kNobody,
      kFailed,
      kAnswered
    };  ///< nobody offers the service; the call broke; there is a response
    typename Service::Response response;
    Outcome outcome = Outcome::kFailed;
    std::shared_future<void> answered;

    /// Whether there is an outcome by then.
    bool waitUntil(Deadline deadline) const { return answered.wait_until(deadline) == std::future_status::ready; }
  };

  /// @param whom  for refusals: "the driver", for instance
  /// @param remedy  what to do when it hangs
  BoundedCall(const ros::ServiceClient& client, const std::string& whom, const std::string& remedy)
      : client_(client), name_(client_.getService()), whom_(whom), remedy_(remedy) {}

  /// @throws TrackingError if an earlier call has not been answered yet
  std::shared_ptr<const Call> begin(const typename Service::Request& request) {
    const std::lock_guard<std::mutex> guard(mutex_);
    const auto now = std::chrono::steady_clock::now();
    if (last_ && !last_->waitUntil(now))
      throw TrackingError(whom_ + " still has not answered the call of " + name_ + " " +
                          secondsText(std::chrono::duration<double>(now - begun_).count()) + " ago; " + remedy_);
    const auto call = std::make_shared<Call>();
    const auto done = std::make_shared<std::promise<void>>();
    call->answered = done->get_future().share();
    last_ = call;
    begun_ = now;
    std::thread([call, done, request, client = client_]() mutable {
      if (!client.exists())
        call->outcome = Call::Outcome::kNobody;
      else if (client.call(request, call->response))
        call->outcome = Call::Outcome::kAnswered;
      done->set_value();
    }).detach();
    return call;
  }

  /// @throws TrackingError also if there is no outcome by then
  std::shared_ptr<const Call> call(const typename Service::Request& request, Deadline deadline) {
    const auto pending = begin(request);
    if (!pending->waitUntil(deadline)) throw TrackingError(hangs());
    return pending;
  }

  std::string hangs() const { return whom_ + " did not answer " + name_ + "; " + remedy_; }

 private:
  ros::ServiceClient client_;
  const std::string name_, whom_, remedy_;
  std::mutex mutex_;
  std::shared_ptr<const Call> last_;
  Deadline begun_;
};

}  // namespace cortshift_tracking

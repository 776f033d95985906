// What peers ask of the shift tracker, and what its stages are: service calls on a thread of their own.
#pragma once

#include <ros/ros.h>

#include <condition_variable>
#include <deque>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "cortshift_tracking/igtl/endpoint.hpp"
#include "cortshift_tracking/igtl/request.hpp"

namespace cortshift_tracking::igt {

/// Calls /shift_tracker/capture_stage, compute_shift, list_stages. Sends STRING CortshiftReply or the answer to a
/// COMMAND to the one who asked, STRING Stages and StageEvent to all.
class RequestWorker {
 public:
  /// @param poll_period  of the list of stages [s]
  RequestWorker(ros::NodeHandle& node, Endpoint& endpoint, double poll_period);
  ~RequestWorker();
  RequestWorker(const RequestWorker&) = delete;
  RequestWorker& operator=(const RequestWorker&) = delete;

  void start();
  void stop();  ///< after the call that is under way

  /// From any thread. @param command  it came as COMMAND
  void request(PeerId peer, const std::string& text, const std::optional<Command>& command);

 private:
  /// A request waiting for the shift tracker, and the one who asked.
  struct Job {
    PeerId peer = 0;
    Request request;
    std::optional<Command> command;
  };

  void work();
  void serve(const Job& job);
  void report(const Job& job, const std::string& what, bool called, bool success, const std::string& message);
  void answer(const Job& job, bool success, const std::string& text);
  void pollStages();
  void publishEvent(const std::string& text);

  Endpoint& endpoint_;
  double poll_period_;
  ros::ServiceClient capture_, compute_, list_;
  std::optional<std::map<std::string, std::string>> stages_;  // the worker's thread alone
  std::uint64_t events_ = 0;                                  // likewise
  std::mutex mutex_;                                          // guards the next two
  std::deque<Job> jobs_;
  bool stop_ = false;
  std::condition_variable changed_;
  std::thread thread_;
};

}  // namespace cortshift_tracking::igt

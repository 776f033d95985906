#include "cortshift_tracking/ros/bridge/request_worker.hpp"

#include <cortshift_msgs/CaptureStage.h>
#include <cortshift_msgs/ComputeShift.h>
#include <cortshift_msgs/ListStages.h>

#include <chrono>

#include "cortshift_tracking/igtl/compose.hpp"
#include "cortshift_tracking/ros/bridge/igtl_conversion.hpp"

namespace cortshift_tracking::igt {
namespace {

std::int64_t now() { return static_cast<std::int64_t>(ros::Time::now().toNSec()); }

}  // namespace

RequestWorker::RequestWorker(ros::NodeHandle& node, Endpoint& endpoint, double poll_period)
    : endpoint_(endpoint),
      poll_period_(poll_period),
      capture_(node.serviceClient<cortshift_msgs::CaptureStage>("shift_tracker/capture_stage")),
      compute_(node.serviceClient<cortshift_msgs::ComputeShift>("shift_tracker/compute_shift")),
      list_(node.serviceClient<cortshift_msgs::ListStages>("shift_tracker/list_stages")) {}

RequestWorker::~RequestWorker() { stop(); }

void RequestWorker::start() {
  thread_ = std::thread([this] { work(); });
}

void RequestWorker::stop() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    stop_ = true;
  }
  changed_.notify_all();
  if (thread_.joinable()) thread_.join();
}

void RequestWorker::request(PeerId peer, const std::string& text, const std::optional<Command>& command) {
  Job job{peer, {}, command};
  try {
    job.request = parseRequest(text);
  } catch (const std::invalid_argument& error) {
    return answer(job, false, error.what());
  }
  constexpr std::size_t kMaxJobs = 4;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (jobs_.size() < kMaxJobs) {
      jobs_.push_back(job);
      changed_.notify_all();
      return;
    }
  }
  answer(job, false, "busy: other requests are waiting; ask again later");
}

void RequestWorker::answer(const Job& job, bool success, const std::string& text) {
  const Label label{"CortshiftReply", now()};
  if (job.command)
    endpoint_.send(job.peer, toPacket(composeCommandReply(label, *job.command, success, text)));
  else
    endpoint_.send(job.peer, toPacket(composeString(label, (success ? "OK " : "REFUSED ") + text)));
}

/// Services take their time, and neither the network nor the topics wait for them.
void RequestWorker::work() {
  auto next_poll = std::chrono::steady_clock::now();
  const auto period =
      std::chrono::duration_cast<std::chrono::steady_clock::duration>(std::chrono::duration<double>(poll_period_));
  for (;;) {
    std::optional<Job> job;
    {
      std::unique_lock<std::mutex> lock(mutex_);
      changed_.wait_until(lock, next_poll, [this] { return stop_ || !jobs_.empty(); });
      if (stop_) return;
      if (!jobs_.empty()) {
        job = jobs_.front();
        jobs_.pop_front();
      }
    }
    try {
      if (job) serve(*job);
      job.reset();
      pollStages();
    } catch (const std::exception& error) {
      ROS_ERROR_STREAM_THROTTLE(5, "OpenIGTLink: a call of the shift tracker failed: " << error.what());
      if (job) answer(*job, false, std::string("the request could not be served: ") + error.what());
    }
    next_poll = std::chrono::steady_clock::now() + period;
  }
}

void RequestWorker::serve(const Job& job) {
  if (job.request.kind == Request::Kind::kCaptureStage) {
    cortshift_msgs::CaptureStage call;
    call.request.key = job.request.key;
    call.request.note = job.request.note;
    const bool called = capture_.call(call);
    report(job, "capture_stage " + job.request.key, called, call.response.success, call.response.message);
  } else {
    cortshift_msgs::ComputeShift call;
    call.request.from_key = job.request.from_key;
    call.request.to_key = job.request.to_key;
    const bool called = compute_.call(call);
    report(job, "compute_shift " + job.request.from_key + " " + job.request.to_key, called, call.response.success,
           call.response.message);
  }
}

void RequestWorker::report(const Job& job, const std::string& what, bool called, bool success,
                           const std::string& message) {
  answer(job, called && success, what + ": " + (called ? message : "shift_tracker does not answer; is it running?"));
}

/// The contract has no topic of stages, so the list is asked for.
void RequestWorker::pollStages() {
  cortshift_msgs::ListStages call;
  if (!list_.exists() || !list_.call(call)) return;
  std::map<std::string, std::string> stages;
  std::string all;
  for (const cortshift_msgs::StageInfo& stage : call.response.stages) {
    stages[stage.key] = stageText(stage);
    all += stages[stage.key] + "\n";
  }
  if (stages_ == stages) return;
  endpoint_.publish("Stages", toPacket(composeString({"Stages", now()}, all)), true);
  if (stages_) {
    for (const auto& [key, text] : stages)
      if (stages_->count(key) == 0) publishEvent("captured " + text);
    for (const auto& [key, text] : *stages_)
      if (stages.count(key) == 0) publishEvent("deleted " + key);
  }
  stages_ = stages;
}

void RequestWorker::publishEvent(const std::string& text) {
  endpoint_.publish("event" + std::to_string(++events_), toPacket(composeString({"StageEvent", now()}, text)), false);
}

}  // namespace cortshift_tracking::igt

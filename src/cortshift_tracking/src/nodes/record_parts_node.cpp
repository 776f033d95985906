/// record_parts --prefix PATH --minutes M --parts N --compression lz4|none [--parent PID] [--hold TOPIC ...] TOPIC ...
///
/// Writes topics to bags in parts that stand alone; case_recorder runs it. Says on standard output, one line each
/// second in which something is new:
///   lost TOPIC COUNT    messages of TOPIC that never arrived, or that the disk was too slow for, since the beginning
///   failed REASON       why it ends
/// Exit status: 0 ended by SIGINT, the last part is whole; 1 failed; 2 bad usage.
///
/// --parent: who started it. When that one is gone it records on, so that nothing is missed, until another of its name
/// registers with the master, which then ends this one; where none does, it ends by itself after kAlone.
#include <ros/ros.h>
#include <unistd.h>

#include <chrono>
#include <condition_variable>
#include <cstdio>
#include <cstdlib>
#include <deque>
#include <iostream>
#include <map>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "cortshift_tracking/ros/recording/part_recorder.hpp"
#include "cortshift_tracking/ros/recording/sequence_watch.hpp"

namespace {

using namespace cortshift_tracking;

constexpr std::size_t kMostWaiting = std::size_t(512) << 20;  // [bytes] twelve seconds of two cameras at 20 MB/s
/// The launch starts a node again after half a second; on a busy machine Python takes some seconds more.
constexpr std::chrono::seconds kAlone(15);

struct Options {
  PartSettings parts;
  std::set<std::string> held;
  std::vector<std::string> topics;
  std::optional<pid_t> parent;
};

/// @throws std::invalid_argument naming the word
Options read(const std::vector<std::string>& words) {
  Options out;
  const auto number = [](const std::string& name, const std::string& text) {
    std::size_t used = 0;
    const double value = std::stod(text, &used);
    if (used != text.size() || !(value > 0)) throw std::invalid_argument(name + " " + text + ": not a number above 0");
    return value;
  };
  for (std::size_t i = 0; i < words.size(); ++i) {
    const std::string& word = words[i];
    if (word.rfind("--", 0) != 0) {
      out.topics.push_back(word);
      continue;
    }
    if (i + 1 == words.size()) throw std::invalid_argument(word + " needs a value");
    const std::string& value = words[++i];
    if (word == "--prefix")
      out.parts.prefix = value;
    else if (word == "--minutes")
      out.parts.duration = 60 * number(word, value);
    else if (word == "--parts")
      out.parts.parts = static_cast<std::size_t>(number(word, value));
    else if (word == "--compression" && (value == "lz4" || value == "none"))
      out.parts.lz4 = value == "lz4";
    else if (word == "--parent")
      out.parent = static_cast<pid_t>(number(word, value));
    else if (word == "--hold")
      out.held.insert(value);
    else
      throw std::invalid_argument(word + " " + value + " is not known");
  }
  if (out.parts.prefix.empty() || out.topics.empty()) throw std::invalid_argument("--prefix and topics are needed");
  return out;
}

/// What has arrived and is not written yet, and what was lost.
class Inbox {
 public:
  void add(const Recorded& message) {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      const std::size_t size = message.message->size();
      lose(message.topic, watch_.missingBefore(message));
      if (waiting_ + size > kMostWaiting) {
        lose(message.topic, 1);
        return;
      }
      waiting_ += size;
      messages_.push_back(message);
    }
    arrived_.notify_one();
  }

  /// What has arrived, after at most a second.
  std::deque<Recorded> take() {
    std::unique_lock<std::mutex> lock(mutex_);
    arrived_.wait_for(lock, std::chrono::milliseconds(500), [this] { return !messages_.empty(); });
    waiting_ = 0;
    return std::exchange(messages_, {});
  }

  /// Topics that have lost more since the last call, with all that they have lost.
  std::map<std::string, std::uint64_t> newlyLost() {
    const std::lock_guard<std::mutex> lock(mutex_);
    std::map<std::string, std::uint64_t> out;
    for (const std::string& topic : new_) out[topic] = lost_[topic];
    new_.clear();
    return out;
  }

 private:
  void lose(const std::string& topic, std::uint64_t count) {
    if (count == 0) return;
    lost_[topic] += count;
    new_.insert(topic);
  }

  std::mutex mutex_;
  std::condition_variable arrived_;
  std::deque<Recorded> messages_;
  std::size_t waiting_ = 0;  ///< bytes in messages_
  SequenceWatch watch_;
  std::map<std::string, std::uint64_t> lost_;
  std::set<std::string> new_;
};

/// Whether nobody is left for whom to record.
class Abandonment {
 public:
  explicit Abandonment(const std::optional<pid_t>& parent) : parent_(parent) {}

  bool certain() {
    const auto now = std::chrono::steady_clock::now();
    if (!parent_ || getppid() == *parent_) with_parent_ = now;
    return now - with_parent_ > kAlone;
  }

 private:
  std::optional<pid_t> parent_;
  std::chrono::steady_clock::time_point with_parent_ = std::chrono::steady_clock::now();
};

/// What roscpp asks of the master for the first line that it logs. Said only when another takes this one's name, that
/// line would register this one anew, and the master would end the other one too.
void askBeforeOthersCome() {
  bool unused;
  ros::param::getCached("/rosout_disable_topics_generation", unused);
}

ros::Subscriber subscribe(ros::NodeHandle& node, const std::string& topic, Inbox& inbox) {
  using Event = ros::MessageEvent<topic_tools::ShapeShifter const>;
  ros::SubscribeOptions options;
  options.topic = topic;
  options.queue_size = 0;  // the inbox bounds what waits
  options.md5sum = ros::message_traits::md5sum<topic_tools::ShapeShifter>();
  options.datatype = ros::message_traits::datatype<topic_tools::ShapeShifter>();
  options.helper =
      boost::make_shared<ros::SubscriptionCallbackHelperT<const Event&>>([topic, &inbox](const Event& event) {
        const ros::Time now = ros::Time::now();
        if (!now.isZero()) inbox.add({topic, now, event.getMessage(), event.getConnectionHeaderPtr()});
      });
  return node.subscribe(options);
}

int record(const Options& options) {
  Inbox inbox;
  ros::NodeHandle node;
  askBeforeOthersCome();
  std::set<std::string> held;
  for (const std::string& topic : options.held) held.insert(node.resolveName(topic));
  std::vector<ros::Subscriber> subscribers;
  for (const std::string& topic : options.topics)
    subscribers.push_back(subscribe(node, node.resolveName(topic), inbox));
  ros::AsyncSpinner spinner(1);
  spinner.start();
  try {
    PartRecorder recorder(options.parts, HeldMessages(held));
    const auto writeAll = [&] {
      for (const Recorded& message : inbox.take()) recorder.write(message);
      for (const auto& [topic, count] : inbox.newlyLost()) std::cout << "lost " << topic << " " << count << std::endl;
    };
    Abandonment abandonment(options.parent);
    while (ros::ok() && !abandonment.certain()) writeAll();
    spinner.stop();
    writeAll();
    recorder.close();
  } catch (const std::exception& error) {
    std::cout << "failed the disk does not take " << options.parts.prefix << ": " << error.what() << std::endl;
    return 1;
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  ros::init(argc, argv, "record_parts");
  Options options;
  try {
    options = read(std::vector<std::string>(argv + 1, argv + argc));
  } catch (const std::logic_error& error) {
    std::fprintf(stderr, "record_parts: %s\n", error.what());
    return 2;
  }
  return record(options);
}

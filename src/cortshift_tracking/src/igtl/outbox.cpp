#include "igtl/outbox.hpp"

#include <algorithm>

namespace cortshift_tracking::igt {

void Outbox::put(Queue& queue, const std::string& topic, const Packet& packet) {
  const auto same =
      std::find_if(queue.begin(), queue.end(), [&](const Entry& e) { return !topic.empty() && e.topic == topic; });
  if (same == queue.end())
    queue.push_back({topic, packet});
  else
    same->packet = packet;
}

void Outbox::join(PeerId peer) {
  const std::lock_guard<std::mutex> lock(mutex_);
  Queue& queue = queues_[peer];
  for (const auto& [topic, packet] : kept_) put(queue, topic, packet);
}

void Outbox::leave(PeerId peer) {
  const std::lock_guard<std::mutex> lock(mutex_);
  queues_.erase(peer);
}

void Outbox::publish(const std::string& topic, const Packet& packet, bool keep) {
  const std::lock_guard<std::mutex> lock(mutex_);
  for (auto& [peer, queue] : queues_) put(queue, topic, packet);
  if (keep) kept_[topic] = packet;
}

void Outbox::send(PeerId peer, const Packet& packet) {
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto queue = queues_.find(peer);
  if (queue != queues_.end()) put(queue->second, "", packet);
}

std::size_t Outbox::waiting(PeerId peer) const {
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto queue = queues_.find(peer);
  return queue == queues_.end() ? 0 : queue->second.size();
}

Packet Outbox::take(PeerId peer) {
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto queue = queues_.find(peer);
  if (queue == queues_.end() || queue->second.empty()) return nullptr;
  const Packet packet = queue->second.front().packet;
  queue->second.pop_front();
  return packet;
}

}  // namespace cortshift_tracking::igt

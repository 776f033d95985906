// Bytes that become a message, none of whose lists can be longer than the bytes are.
#pragma once

#include <ros/serialization.h>

#include <cstring>
#include <string>
#include <vector>

namespace cortshift_tracking {

/// ros::serialization::IStream makes room for a list before it looks whether the list is there: a damaged length of
/// four thousand million takes all memory. Here it throws ros::serialization::StreamOverrunException.
class CheckedStream : public ros::serialization::IStream {
 public:
  using IStream::IStream;

  template <typename T>
  void next(T& value) {
    ros::serialization::deserialize(*this, value);
  }
  template <typename T, typename Allocator>
  void next(std::vector<T, Allocator>& list) {
    requireLength();
    ros::serialization::deserialize(*this, list);
  }
  template <typename Traits, typename Allocator>
  void next(std::basic_string<char, Traits, Allocator>& text) {
    requireLength();
    ros::serialization::deserialize(*this, text);
  }

 private:
  void requireLength() {
    std::uint32_t length = 0;
    if (getLength() < sizeof length) ros::serialization::throwStreamOverrun();
    std::memcpy(&length, getData(), sizeof length);
    if (length > getLength() - sizeof length)
      ros::serialization::throwStreamOverrun();  // an element has a byte or more
  }
};

}  // namespace cortshift_tracking

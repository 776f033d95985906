// What a part of a recording begins with, and which messages are missing, without a graph.
#include <geometry_msgs/PoseStamped.h>
#include <gmock/gmock.h>
#include <rosbag/view.h>
#include <std_msgs/String.h>
#include <tf2_msgs/TFMessage.h>

#include <filesystem>
#include <fstream>
#include <set>

#include "cortshift_tracking/ros/recording/part_recorder.hpp"
#include "cortshift_tracking/ros/recording/sequence_watch.hpp"

namespace cortshift_tracking {
namespace {

namespace fs = std::filesystem;

template <typename Message>
Recorded recorded(const std::string& topic, double time, const Message& message, const std::string& caller = "/a",
                  bool latching = true) {
  auto shape = boost::make_shared<topic_tools::ShapeShifter>();
  shape->morph(ros::message_traits::md5sum(message), ros::message_traits::datatype(message),
               ros::message_traits::definition(message), latching ? "1" : "0");
  std::vector<std::uint8_t> bytes(ros::serialization::serializationLength(message));
  ros::serialization::OStream out(bytes.data(), static_cast<std::uint32_t>(bytes.size()));
  ros::serialization::serialize(out, message);
  ros::serialization::IStream in(bytes.data(), static_cast<std::uint32_t>(bytes.size()));
  shape->read(in);
  auto header = boost::make_shared<ros::M_string>();
  *header = {{"callerid", caller},
             {"latching", latching ? "1" : "0"},
             {"topic", topic},
             {"type", shape->getDataType()},
             {"md5sum", shape->getMD5Sum()},
             {"message_definition", shape->getMessageDefinition()}};
  return {topic, ros::Time(time), shape, header};
}

Recorded text(const std::string& topic, double time, const std::string& data, bool latching = true) {
  std_msgs::String message;
  message.data = data;
  return recorded(topic, time, message, "/a", latching);
}

Recorded edges(double time, const std::vector<std::pair<std::string, double>>& children, const std::string& caller) {
  tf2_msgs::TFMessage message;
  for (const auto& [child, x] : children) {
    message.transforms.emplace_back();
    message.transforms.back().child_frame_id = child;
    message.transforms.back().transform.translation.x = x;
  }
  return recorded("/tf_static", time, message, caller);
}

std::vector<std::string> saidAt(const HeldMessages& held) {
  std::vector<std::string> out;
  for (const Recorded& message : held.at(ros::Time(100))) {
    EXPECT_EQ(message.time, ros::Time(100));
    if (message.topic != "/tf_static") {
      out.push_back(message.topic + " " + message.message->instantiate<std_msgs::String>()->data);
      continue;
    }
    const auto edges = message.message->instantiate<tf2_msgs::TFMessage>();
    for (const auto& edge : edges->transforms)
      out.push_back(message.said("callerid") + " " + edge.child_frame_id + " " +
                    std::to_string(static_cast<int>(edge.transform.translation.x)));
  }
  return out;
}

TEST(HeldMessages, LastOfEachLatchedTopic) {
  HeldMessages held({"/info"});
  held.keep(text("/settings", 1, "old"));
  held.keep(text("/image", 2, "image", false));
  held.keep(text("/info", 3, "info", false));
  held.keep(text("/settings", 4, "new"));
  EXPECT_THAT(saidAt(held), testing::ElementsAre("/info info", "/settings new"));
}

TEST(HeldMessages, EveryStaticEdgeAsItWasSaidLast) {
  HeldMessages held;
  held.keep(edges(1, {{"reference", 1}, {"left_optical", 2}}, "/a"));
  held.keep(edges(3, {{"right_optical", 4}}, "/a"));
  held.keep(edges(4, {{"reference", 5}}, "/a"));
  EXPECT_THAT(saidAt(held), testing::ElementsAre("/a left_optical 2", "/a right_optical 4", "/a reference 5"));
}

TEST(HeldMessages, AStaticEdgeThatAnotherNodePublishesAgainTakesThePlaceOfTheFormer) {
  HeldMessages held;
  held.keep(edges(1, {{"left_optical", 1}, {"right_optical", 2}}, "/static_transform_publisher_1"));
  held.keep(edges(1.31, {{"left_optical", 3}}, "/static_transform_publisher_2"));
  EXPECT_THAT(saidAt(held), testing::ElementsAre("/static_transform_publisher_1 right_optical 2",
                                                 "/static_transform_publisher_2 left_optical 3"));
  held.keep(edges(50, {{"left_optical", 4}}, "/static_transform_publisher_1"));
  EXPECT_THAT(saidAt(held), testing::ElementsAre("/static_transform_publisher_1 right_optical 2",
                                                 "/static_transform_publisher_1 left_optical 4"));
}

TEST(HeldMessages, TwoTruthsSaidTogetherBothStayVisible) {
  HeldMessages held;
  held.keep(edges(1, {{"reference", 1}}, "/a"));
  held.keep(edges(1.29, {{"reference", 2}}, "/b"));
  EXPECT_THAT(saidAt(held), testing::ElementsAre("/a reference 1", "/b reference 2"));
  held.keep(edges(1.35, {{"reference", 1}}, "/a"));  // said again: both within the time of the other
  EXPECT_THAT(saidAt(held), testing::ElementsAre("/b reference 2", "/a reference 1"));
}

Recorded numbered(std::uint32_t number, const std::string& caller = "/a", const std::string& topic = "/pose") {
  geometry_msgs::PoseStamped message;
  message.header.seq = number;
  return recorded(topic, number, message, caller, false);
}

TEST(SequenceWatch, CountsWhatIsMissing) {
  SequenceWatch watch;
  EXPECT_EQ(watch.missingBefore(numbered(10)), 0u);
  EXPECT_EQ(watch.missingBefore(numbered(11)), 0u);
  EXPECT_EQ(watch.missingBefore(numbered(14)), 2u);
  EXPECT_EQ(watch.missingBefore(numbered(70000, "/b")), 0u) << "another publisher counts for itself";
  EXPECT_EQ(watch.missingBefore(numbered(3, "/a", "/other")), 0u) << "and so does another topic";
  EXPECT_EQ(watch.missingBefore(numbered(70256, "/b")), 255u) << "all four bytes count";
  EXPECT_EQ(watch.missingBefore(numbered(1)), 0u) << "begun anew";
  EXPECT_EQ(watch.missingBefore(numbered(3)), 1u);
}

TEST(SequenceWatch, AsksOnlyWhatBeginsWithAHeader) {
  SequenceWatch watch;
  EXPECT_EQ(watch.missingBefore(text("/text", 1, "aaaa")), 0u);
  EXPECT_EQ(watch.missingBefore(text("/text", 2, "aaaaaaaaaaaa")), 0u);
  EXPECT_EQ(watch.missingBefore(edges(1, {{"a", 1}}, "/a")), 0u);
  EXPECT_EQ(watch.missingBefore(edges(2, {{"a", 1}, {"b", 1}, {"c", 1}}, "/a")), 0u);
}

class Parts : public testing::Test {
 protected:
  Parts() : folder_(fs::temp_directory_path() / ("parts_" + std::to_string(::getpid()))) {
    fs::create_directory(folder_);
  }
  ~Parts() override { fs::remove_all(folder_); }

  PartSettings settings(std::size_t parts) const { return {(folder_ / "case").string(), 10, parts, true}; }

  std::set<std::string> files() const {
    std::set<std::string> out;
    for (const auto& entry : fs::directory_iterator(folder_)) out.insert(entry.path().filename().string());
    return out;
  }

  /// "time topic" of every message of a part.
  std::vector<std::string> contents(const std::string& name) const {
    rosbag::Bag bag((folder_ / name).string());
    std::vector<std::string> out;
    for (const auto& message : rosbag::View(bag))
      out.push_back(std::to_string(message.getTime().sec) + " " + message.getTopic() + " " + message.getCallerId());
    return out;
  }

  const fs::path folder_;
};

TEST_F(Parts, BeginWithWhatHoldsAndEndWithTheOldestGivenUp) {
  {
    PartRecorder recorder(settings(2), HeldMessages());
    recorder.write(text("/settings", 1, "a"));
    recorder.write(edges(2, {{"reference", 1}}, "/a"));
    recorder.write(edges(2.5, {{"left_optical", 2}}, "/former"));
    recorder.write(edges(3, {{"left_optical", 2}}, "/b"));  // in the place of the former
    for (int second = 4; second < 45; second += 4) recorder.write(text("/image", second, "i", false));
    EXPECT_THAT(files(), testing::Contains("case_0003.bag.active"));
  }
  EXPECT_THAT(files(), testing::ElementsAre("case_0002.bag", "case_0003.bag"));
  EXPECT_THAT(contents("case_0003.bag"),
              testing::UnorderedElementsAre("36 /settings /a", "36 /tf_static /a", "36 /tf_static /b", "36 /image /a",
                                            "40 /image /a", "44 /image /a"));
}

TEST_F(Parts, AClockThatIsSetBackBeginsAPart) {
  {
    PartRecorder recorder(settings(5), HeldMessages());
    recorder.write(text("/image", 100, "i", false));
    recorder.write(text("/image", 50, "i", false));
  }
  EXPECT_THAT(contents("case_0000.bag"), testing::ElementsAre("100 /image /a"));
  EXPECT_THAT(contents("case_0001.bag"), testing::ElementsAre("50 /image /a"));
}

TEST_F(Parts, AFolderThatIsGoneIsAnError) {
  PartRecorder recorder({(folder_ / "gone" / "case").string(), 10, 2, false}, HeldMessages());
  EXPECT_THROW(recorder.write(text("/image", 1, "i")), rosbag::BagException);
}

}  // namespace
}  // namespace cortshift_tracking

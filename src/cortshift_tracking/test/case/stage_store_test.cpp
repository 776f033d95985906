#include <gtest/gtest.h>
#include <linux/capability.h>
#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <signal.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstring>
#include <fstream>
#include <random>
#include <set>
#include <thread>

#include "case/case_folder.hpp"
#include "case/failing_disk.hpp"
#include "case/stage_samples.hpp"
#include "cortshift_tracking/error.hpp"

namespace cortshift_tracking {
namespace {

namespace fs = std::filesystem;

/// Captures one stage after the other and says each acknowledged key on a pipe.
[[noreturn]] void captureUntilKilled(const fs::path& folder, int pipe_end) {
  try {
    StageStore store(folder);
    for (unsigned i = 0;; ++i) {
      const std::string key = "k" + std::to_string(::getpid()) + "-" + std::to_string(i), line = key + "\n";
      store.add(sampleStage(key));
      if (::write(pipe_end, line.data(), line.size()) != static_cast<ssize_t>(line.size())) break;
    }
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
  }
  ::_exit(1);
}

using StageStoreTest = CaseFolderTest;

TEST_F(StageStoreTest, KeepsEverythingInOrderAcrossRestarts) {
  StageRecord full = sampleStage("second");
  auto image = boost::make_shared<sensor_msgs::Image>();
  image->header.stamp = full.info.stamp;
  image->data.assign(1000, 7);
  full.left = image;
  auto info = boost::make_shared<sensor_msgs::CameraInfo>();
  info->K[0] = 1234.5;
  full.left_info = info;
  full.tf.transforms.resize(1);
  full.tf.transforms[0].child_frame_id = "microscope";
  {
    StageStore store(folder);
    store.add(sampleStage("zeta"));
    store.add(full);
    store.add(sampleStage("alpha"));
  }
  StageStore store(folder);
  const auto stages = store.list();
  ASSERT_EQ(stages.size(), 3U);
  EXPECT_EQ(stages[0].key, "zeta");
  EXPECT_EQ(stages[1].key, "second");
  EXPECT_EQ(stages[2].key, "alpha");
  EXPECT_TRUE(isWhole(store.load("zeta")));
  const StageRecord second = store.load("second");
  EXPECT_TRUE(isWhole(second));
  ASSERT_TRUE(second.left);
  EXPECT_EQ(second.left->data, image->data);
  ASSERT_TRUE(second.left_info);
  EXPECT_EQ(second.left_info->K[0], 1234.5);
  ASSERT_EQ(second.tf.transforms.size(), 1U);
  EXPECT_EQ(second.tf.transforms[0].child_frame_id, "microscope");
  EXPECT_FALSE(second.right);
  EXPECT_TRUE(store.setAside().empty());
}

TEST_F(StageStoreTest, AStageIsAnOrdinaryBag) {
  StageStore store(folder);
  store.add(sampleStage("one"));
  rosbag::Bag bag(bags().at(0).string(), rosbag::bagmode::Read);
  std::set<std::string> topics;
  for (const rosbag::MessageInstance& message : rosbag::View(bag)) topics.insert(message.getTopic());
  EXPECT_EQ(topics, (std::set<std::string>{"/stage/info", "/surface/points"}));
}

TEST_F(StageStoreTest, RefusesDuplicatesUnknownKeysAndASecondOwner) {
  StageStore store(folder);
  store.add(sampleStage("one"));
  const std::string before = readWhole(bags().at(0));
  EXPECT_NE(refusal([&] { store.add(sampleStage("one", 5000)); }).find("exists already"), std::string::npos);
  EXPECT_EQ(readWhole(bags().at(0)), before);
  EXPECT_NE(refusal([&] { store.load("two"); }).find("there are: one"), std::string::npos);
  EXPECT_NE(refusal([&] { StageStore second(folder); }).find("in use by another process"), std::string::npos);
}

TEST_F(StageStoreTest, DeletedStagesStayOnDiskAndTheirNumberIsNotUsedAgain) {
  {
    StageStore store(folder);
    store.add(sampleStage("one"));
    store.add(sampleStage("two"));
    store.remove("two");
    store.add(sampleStage("two", 5000));
  }
  StageStore store(folder);
  EXPECT_EQ(store.list().size(), 2U);
  EXPECT_EQ(store.load("two").surface->data.size(), 5000U);
  EXPECT_EQ(std::distance(fs::directory_iterator(folder / "deleted"), {}), 1);
  EXPECT_EQ(bags().at(1).filename().string().substr(0, 9), "0003_two_");
}

TEST_F(StageStoreTest, WhereTheFileSystemHasNoLocksACaseIsUsedWithAWarning) {
  for (const int failure : {ENOLCK, EOPNOTSUPP, ENOSYS}) {
    failing_disk::lock_failure = failure;
    StageStore store(folder / std::to_string(failure));
    failing_disk::lock_failure = 0;
    store.add(sampleStage("one"));
    EXPECT_EQ(store.warnings(),
              std::vector<std::string>{"that nobody else uses it cannot be made sure (" +
                                       std::string(std::strerror(failure)) +
                                       "): let no other process use it, or set case_folder to a folder of this "
                                       "machine's disk"});
  }
  failing_disk::lock_failure = EWOULDBLOCK;
  const std::string used = refusal([&] { StageStore second(folder); });
  failing_disk::lock_failure = 0;
  EXPECT_NE(used.find(" is in use by another process; stop that one or set case_folder to another"), std::string::npos);
}

TEST_F(StageStoreTest, BagsThatAreNotNamedLikeStagesStayWhereTheyAre) {
  fs::create_directories(folder);
  const std::set<std::string> names = {"field.bag", "123_short.bag", "case_0001.bag", "0001-one.bag",
                                       "1234567890_long.bag"};
  for (const std::string& name : names) std::ofstream(folder / name) << "a recording of /shift/field";
  StageStore store(folder);
  EXPECT_TRUE(store.list().empty());
  EXPECT_TRUE(store.setAside().empty());
  EXPECT_TRUE(store.warnings().empty());
  for (const std::string& name : names) EXPECT_TRUE(fs::exists(folder / name)) << name;
  store.add(sampleStage("one"));
  EXPECT_EQ(store.list().size(), 1U);
}

TEST_F(StageStoreTest, DamagedAndForeignBagsAreSetAsideAndNamed) {
  {
    StageStore store(folder);
    for (const char* key : {"whole", "flipped", "short"}) store.add(sampleStage(key));
  }
  const auto files = bags();
  {  // one bit in the middle
    std::fstream file(files[1], std::ios::in | std::ios::out | std::ios::binary);
    file.seekg(150000);
    const char byte = static_cast<char>(file.get() ^ 4);
    file.seekp(150000);
    file.put(byte);
  }
  fs::resize_file(files[2], 100000);
  std::ofstream(folder / "0005_recording.bag") << "no bag at all";
  {  // another case's stage under a key that is taken
    StageStore other(folder / "other");
    other.add(sampleStage("whole", 4000));
  }
  const fs::path twin = fs::directory_iterator(folder / "other")->path().extension() == ".bag"
                            ? fs::directory_iterator(folder / "other")->path()
                            : std::next(fs::directory_iterator(folder / "other"))->path();
  fs::copy(twin, folder / ("0009" + twin.filename().string().substr(4)));
  std::ofstream(folder / "probe_points.json") << "{}";
  std::ofstream(folder / "0010_half_00000000.bag.partial") << "half";

  StageStore store(folder);
  ASSERT_EQ(store.list().size(), 1U);
  EXPECT_TRUE(isWhole(store.load("whole")));
  ASSERT_EQ(store.setAside().size(), 4U);
  std::string all;
  for (const std::string& line : store.setAside()) all += line + "\n";
  EXPECT_NE(all.find(files[1].filename().string() + ": its content does not have the checksum"), std::string::npos);
  EXPECT_NE(all.find(files[2].filename().string()), std::string::npos);
  EXPECT_NE(all.find("0005_recording.bag: its name is not that of a stage; it is set aside as " +
                     (folder / "set_aside").string()),
            std::string::npos)
      << all;
  EXPECT_NE(all.find("is that of"), std::string::npos);
  EXPECT_EQ(std::distance(fs::directory_iterator(folder / "set_aside"), {}), 4);
  EXPECT_TRUE(fs::exists(folder / "probe_points.json"));
  EXPECT_FALSE(fs::exists(folder / "0010_half_00000000.bag.partial"));
  EXPECT_EQ(store.warnings(),
            std::vector<std::string>{"removed 0010_half_00000000.bag.partial, left by a capture that was interrupted"});
  store.add(sampleStage("flipped"));  // the key is free again
}

TEST_F(StageStoreTest, DamageAfterTheStartIsNoticedWhenTheStageIsUsed) {
  StageStore store(folder);
  store.add(sampleStage("one"));
  fs::resize_file(bags().at(0), 1000);
  EXPECT_NE(refusal([&] { store.load("one"); }).find("stage 'one' cannot be read"), std::string::npos);
}

TEST_F(StageStoreTest, AFullDiskRefusesAndLeavesNothingBehind) {
  StageStore store(folder);
  store.add(sampleStage("one"));
  for (const long room : {0L, 1L, 100000L, 299999L}) {
    failing_disk::room = room;
    const std::string reason = refusal([&] { store.add(sampleStage("large")); });
    failing_disk::room = failing_disk::kUnlimited;
    EXPECT_NE(reason.find("No space left on device"), std::string::npos) << reason;
    EXPECT_EQ(store.list().size(), 1U);
    EXPECT_EQ(std::distance(fs::directory_iterator(folder), {}), 2);  // the stage and the lock
  }
  store.add(sampleStage("large"));  // once there is room again
  EXPECT_TRUE(isWhole(store.load("large")));
}

TEST_F(StageStoreTest, ADiskThatCannotSyncIsNotBelieved) {
  StageStore store(folder);
  failing_disk::sync_works = false;
  const std::string reason = refusal([&] { store.add(sampleStage("one")); });
  failing_disk::sync_works = true;
  EXPECT_NE(reason.find("cannot sync"), std::string::npos) << reason;
  EXPECT_TRUE(store.list().empty());
  EXPECT_TRUE(bags().empty());
}

/// Root's processes ignore permissions until they give up the right to. (Another user may not even reach the folder.)
bool obeyPermissions() {
  if (::geteuid() != 0) return true;
  __user_cap_header_struct header{_LINUX_CAPABILITY_VERSION_3, 0};
  std::array<__user_cap_data_struct, _LINUX_CAPABILITY_U32S_3> none{};
  return ::syscall(SYS_capset, &header, none.data()) == 0;
}

TEST_F(StageStoreTest, AReadOnlyFolderCanBeReadAndRefusesCaptures) {
  {
    StageStore store(folder);
    store.add(sampleStage("one"));
  }
  fs::permissions(folder, fs::perms(0555));
  fs::permissions(folder / ".lock", fs::perms(0444));
  const pid_t child = ::fork();
  ASSERT_GE(child, 0);
  if (child == 0) {
    if (!obeyPermissions()) ::_exit(9);
    try {
      StageStore store(folder);
      if (store.list().size() != 1 || !isWhole(store.load("one"))) ::_exit(2);
      if (refusal([&] { store.add(sampleStage("two")); }).empty()) ::_exit(3);
      if (refusal([&] { store.remove("one"); }).empty()) ::_exit(4);
      if (store.list().size() != 1) ::_exit(5);
    } catch (const std::exception& error) {
      std::fprintf(stderr, "%s\n", error.what());
      ::_exit(6);
    }
    ::_exit(0);
  }
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  EXPECT_TRUE(WIFEXITED(status));
  EXPECT_EQ(WEXITSTATUS(status), 0);
  fs::permissions(folder, fs::perms::owner_all);
}

TEST_F(StageStoreTest, StagesAreReadAndCapturedAtTheSameTime) {
  StageStore store(folder);
  store.add(sampleStage("first"));
  std::vector<std::thread> threads;
  for (int reader = 0; reader < 3; ++reader)
    threads.emplace_back([&store] {
      for (int i = 0; i < 50; ++i) EXPECT_TRUE(isWhole(store.load("first")));
    });
  for (int i = 0; i < 30; ++i) EXPECT_NO_THROW(store.add(sampleStage("more_" + std::to_string(i))));
  for (std::thread& thread : threads) thread.join();
}

TEST_F(StageStoreTest, SurvivesKillAtRandomInstants) {
  std::mt19937 random(20140101);
  // Kills fall into the first few captures, however long this machine and this build take for one.
  const auto began = std::chrono::steady_clock::now();
  StageStore(folder / "timed").add(sampleStage("one"));
  const std::chrono::duration<double, std::micro> one = std::chrono::steady_clock::now() - began;
  std::uniform_int_distribution<int> microseconds(0, static_cast<int>(4 * one.count()));
  std::set<std::string> acknowledged;
  std::size_t interrupted = 0;
  for (int round = 0; round < 200; ++round) {
    int pipe_ends[2];
    ASSERT_EQ(::pipe(pipe_ends), 0);
    const pid_t child = ::fork();
    ASSERT_GE(child, 0);
    if (child == 0) captureUntilKilled(folder, pipe_ends[1]);
    ::close(pipe_ends[1]);
    char byte;
    std::string said;
    if (::read(pipe_ends[0], &byte, 1) == 1) said += byte;  // it captures now
    ::usleep(static_cast<useconds_t>(microseconds(random)));
    ::kill(child, SIGKILL);
    ::waitpid(child, nullptr, 0);
    while (::read(pipe_ends[0], &byte, 1) == 1) said += byte;
    ::close(pipe_ends[0]);
    std::size_t begin = 0;
    for (std::size_t end; (end = said.find('\n', begin)) != std::string::npos; begin = end + 1)
      acknowledged.insert(said.substr(begin, end - begin));
    for (const auto& file : fs::directory_iterator(folder))
      if (file.path().extension() == ".partial") ++interrupted;

    // After each restart: all that was acknowledged is there and whole, and nothing is there in part.
    StageStore store(folder);
    ASSERT_TRUE(store.setAside().empty()) << store.setAside().front();
    std::set<std::string> found;
    for (const auto& stage : store.list()) found.insert(stage.key);
    for (const std::string& key : acknowledged) ASSERT_TRUE(found.count(key)) << key;
    for (const std::string& key : found) ASSERT_TRUE(isWhole(store.load(key))) << key;
    for (const std::string& key : found) store.remove(key);  // keep the rounds quick
    acknowledged.clear();
    fs::remove_all(folder / "deleted");
  }
  EXPECT_GT(interrupted, 5U);  // otherwise the kills did not hit captures
}

}  // namespace
}  // namespace cortshift_tracking

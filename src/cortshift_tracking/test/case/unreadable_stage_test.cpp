// A stage whose file cannot be read just now is no damaged stage.
#include <cerrno>

#include "case/case_folder.hpp"
#include "case/failing_disk.hpp"
#include "case/failing_memory.hpp"
#include "case/stage_samples.hpp"
#include "cortshift_tracking/case/patient_registration.hpp"
#include "cortshift_tracking/ros/stage_shift.hpp"

namespace cortshift_tracking {
namespace {

namespace fs = std::filesystem;

class UnreadableStage : public CaseFolderTest {
 protected:
  UnreadableStage() {
    StageStore store(folder);
    for (const char* key : {"one", "two", "three"}) store.add(sampleStage(key));
  }
  ~UnreadableStage() override {
    failing_disk::read_failure = 0;
    failing_disk::streams_that_fail = "";
    failing_memory::pieces = failing_memory::kUnlimited;
  }
};

TEST_F(UnreadableStage, StaysAndIsReadWhenItIsAskedFor) {
  const auto files = bags();
  for (const int failure : {EIO, EACCES, ENOMEM}) {
    failing_disk::read_failure = failure;
    StageStore store(folder);
    failing_disk::read_failure = 0;
    EXPECT_EQ(bags(), files);
    EXPECT_TRUE(store.setAside().empty());
    EXPECT_FALSE(fs::exists(folder / "set_aside"));
    ASSERT_EQ(store.unreadable().size(), 3U);
    EXPECT_TRUE(holds(store.unreadable()[1], files[1].filename().string()));
    EXPECT_TRUE(holds(store.unreadable()[1], std::strerror(failure)));
    EXPECT_TRUE(isWhole(store.load("two")));
    EXPECT_EQ(store.unreadable().size(), 2U);
    store.retryUnreadable();
    EXPECT_TRUE(store.unreadable().empty());
    EXPECT_EQ(store.infoOf("one").note, "note of one");
  }
}

// Either the bag or the description of rosbag's own plugins, without which it opens no bag at all.
TEST_F(UnreadableStage, StaysWhereRosbagCannotReadIt) {
  const auto files = bags();
  for (const char* const ending : {".bag", "encryptor_plugins.xml"}) {
    SCOPED_TRACE(ending);
    failing_disk::streams_that_fail = ending;
    StageStore store(folder);
    failing_disk::streams_that_fail = "";
    EXPECT_EQ(bags(), files);
    EXPECT_TRUE(store.setAside().empty());
    ASSERT_EQ(store.unreadable().size(), 3U);
    EXPECT_TRUE(holds(store.unreadable()[0], "cannot read"));
    EXPECT_TRUE(isWhole(store.load("one")));
  }
}

// Memory is short from the first large piece on, then from the second, ... until all that reading takes is given.
TEST_F(UnreadableStage, StaysWhereThereIsNoMemoryForIt) {
  const auto files = bags();
  long given = 0;
  for (bool short_of_memory = true; short_of_memory; ++given) {
    SCOPED_TRACE(given);
    failing_memory::pieces = given;
    StageStore store(folder);
    failing_memory::pieces = failing_memory::kUnlimited;
    EXPECT_EQ(bags(), files);
    EXPECT_TRUE(store.setAside().empty());
    short_of_memory = !store.unreadable().empty();
    for (const std::string& line : store.unreadable())
      EXPECT_TRUE(holds(line, "no memory") || holds(line, std::strerror(ENOMEM))) << line;
    store.retryUnreadable();
    EXPECT_TRUE(store.unreadable().empty());
    EXPECT_TRUE(isWhole(store.load("three")));
  }
  EXPECT_GT(given, 2 * 3) << "the bytes of a stage, and the surface in them";
}

TEST_F(UnreadableStage, KeepsItsKeyItsPlaceAndItsReason) {
  failing_disk::read_failure = EIO;
  StageStore store(folder);
  EXPECT_TRUE(holds(refusal([&] { store.load("two"); }), "stage 'two' cannot be read"));
  failing_disk::read_failure = 0;
  EXPECT_TRUE(holds(refusal([&] { store.requireFree("two"); }), "exists already, though it cannot be read now"));
  EXPECT_TRUE(holds(refusal([&] { store.add(sampleStage("two")); }), "exists already"));
  const auto stages = store.list();
  ASSERT_EQ(stages.size(), 3U);
  for (std::size_t i = 0; i < 3; ++i) EXPECT_EQ(store.indexOf(stages[i].key), i);
  EXPECT_TRUE(holds(stages[1].note, "cannot be read now: "));
  EXPECT_EQ(stages[1].valid_points, 0U);
  store.add(sampleStage("four"));  // a case goes on
  EXPECT_TRUE(isWhole(store.load("four")));
  EXPECT_EQ(bags().size(), 4U);
}

TEST_F(UnreadableStage, ThatIsFoundDamagedLaterStaysToo) {
  failing_disk::read_failure = EIO;
  const StageStore store(folder);
  failing_disk::read_failure = 0;
  fs::resize_file(bags().at(0), 1000);
  EXPECT_TRUE(holds(refusal([&] { store.load("one"); }), "checksum"));
  EXPECT_EQ(store.indexOf("one"), 0U);
}

// While a stage of epoch 1 could not be read, one of another registration was counted as epoch 1 too.
TEST_F(UnreadableStage, DoesNotLetTwoRegistrationsPassAsOneEpoch) {
  const auto withRegistration = [](const char* key, double x) {
    StageRecord record = sampleStage(key);
    record.info.registration.position.x = x;
    record.info.registration.orientation.w = 1;
    return record;
  };
  fs::path case_folder = folder / "epochs";
  { StageStore(case_folder).add(withRegistration("before", 0.1)); }
  failing_disk::read_failure = EIO;
  StageStore store(case_folder);
  failing_disk::read_failure = 0;  // a stage is put together in a file in memory, which is read as well
  EXPECT_EQ(store.add(withRegistration("after", 0.2)).epoch, 1U);
  EXPECT_EQ(store.load("before").info.epoch, 1U);
  FirstNormal normal;
  EXPECT_TRUE(holds(refusal([&] { computeStageShift(store, "before", "after", normal, {}, {}); }),
                    "the patient registration changed between 'before'"));
}

}  // namespace
}  // namespace cortshift_tracking

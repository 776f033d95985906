#include "cortshift_tracking/case/case_state.hpp"

#include <cerrno>
#include <fstream>

#include "case/case_folder.hpp"
#include "case/failing_disk.hpp"
#include "cortshift_tracking/case/durable_file.hpp"

namespace cortshift_tracking {
namespace {

namespace fs = std::filesystem;

const Eigen::Vector3d kDown = Eigen::Vector3d(0.1, -0.9, 0.05).normalized();
const std::vector<Region> kRegions = {{{0.001, 0.002}, {0.0103, 0.002}, {0.01, 0.3}},
                                      {{1e-9, 0}, {0.1, 0}, {0.1, 0.1}, {0, 0.1}}};

class CaseStateTest : public CaseFolderTest {
 protected:
  ~CaseStateTest() override {
    failing_disk::read_failure = 0;
    failing_disk::room = failing_disk::kUnlimited;
  }

  static cortshift_msgs::StageInfo stage(const std::string& key, double seconds) {
    cortshift_msgs::StageInfo info;
    info.key = key;
    info.stamp = ros::Time(seconds);
    return info;
  }

  void leave(const std::string& text) const { std::ofstream(file()) << text; }
  fs::path file() const { return folder / "case_state.json"; }
};

TEST_F(CaseStateTest, IsThereAgainToTheLastBit) {
  {
    CaseState state(folder, {});
    EXPECT_FALSE(state.gravity());
    EXPECT_FALSE(fs::exists(file()));
    state.setGravity(kDown, "a test's \"own\"");
    state.exclude(stage("a", 12.345678901), kRegions);
    state.exclude(stage("b", 13), {kRegions[0]});
    state.exclude(stage("b", 13), {});  // replaces
  }
  const CaseState state(folder, {});
  ASSERT_TRUE(state.gravity());
  EXPECT_EQ(state.gravity()->direction_pmr, kDown);
  EXPECT_EQ(state.gravity()->source, "a test's 'own'");
  EXPECT_EQ(state.regionsOf(stage("a", 12.345678901)), kRegions);
  EXPECT_TRUE(state.regionsOf(stage("b", 13)).empty());
  EXPECT_EQ(state.regions({stage("a", 12.345678901), stage("b", 13), stage("c", 14)}), (RegionsByKey{{"a", kRegions}}));
  EXPECT_EQ(state.trouble(), "");
}

TEST_F(CaseStateTest, LiveModeIsThereAgainUntilItIsSwitchedOff) {
  const LiveMode live{"a", ros::Time(12, 345678901), "8f1e-run"};
  {
    CaseState state(folder, {});
    state.setLive(std::nullopt);
    EXPECT_FALSE(fs::exists(file()));
    state.setGravity(kDown, "a test");
    state.setLive(live);
  }
  CaseState state(folder, {});
  ASSERT_TRUE(state.live());
  EXPECT_EQ(state.live()->key, "a");
  EXPECT_EQ(state.live()->stamp, live.stamp);
  EXPECT_EQ(state.live()->run, live.run);
  EXPECT_EQ(state.gravity()->direction_pmr, kDown);
  state.setLive(std::nullopt);
  EXPECT_FALSE(CaseState(folder, {}).live());
}

TEST_F(CaseStateTest, RegionsBelongToOneCapture) {
  CaseState state(folder, {});
  state.exclude(stage("a", 1), kRegions);
  EXPECT_TRUE(state.regionsOf(stage("a", 2)).empty());  // captured anew, the deletion was not completed
  EXPECT_EQ(state.regionsOf(stage("a", 0)), kRegions);  // its stamp cannot be read: rather excluded than forgotten
  state.forget("a");
  EXPECT_TRUE(state.regionsOf(stage("a", 1)).empty());
  EXPECT_TRUE(holds(refusal([&] { state.exclude(stage("a", 1), {{{0, 0}, {1, 1}}}); }), "fewer than three corners"));
}

TEST_F(CaseStateTest, OutlinesAreThereAgainAndGoWithTheirStage) {
  {
    CaseState state(folder, {std::nullopt, {{"a", {kRegions[0]}}}});
    state.setOutline(stage("a", 1.5), kRegions);
    state.setOutline(stage("b", 2), {kRegions[0]});
    state.setOutline(stage("c", 3), kRegions);
    state.setOutline(stage("c", 3), {});  // the automatic one again
    EXPECT_TRUE(holds(refusal([&] {
                        state.setOutline(stage("a", 1.5), {{{0, 0}, {1, 1}}});
                      }),
                      "fewer than three corners"));
  }
  CaseState state(folder, {});
  EXPECT_EQ(state.outlineOf(stage("a", 1.5)), kRegions);
  EXPECT_TRUE(state.outlineOf(stage("a", 7)).empty());  // captured anew
  EXPECT_TRUE(state.regionsOf(stage("a", 1.5)).empty()) << "an outline excludes nothing";
  EXPECT_EQ(state.outlines({stage("a", 1.5), stage("b", 2), stage("c", 3)}),
            (RegionsByKey{{"a", kRegions}, {"b", {kRegions[0]}}}));
  state.forget("a");
  EXPECT_TRUE(state.outlineOf(stage("a", 1.5)).empty());
  EXPECT_EQ(CaseState(folder, {}).outlineOf(stage("b", 2)), RegionsByKey::mapped_type{kRegions[0]});
}

TEST_F(CaseStateTest, ACaseFromBeforeThereWereOutlinesHasNone) {
  leave(R"({"format": "cortshift case state, version 1", "unit": "m", "gravity": null, "excluded": {}})");
  const CaseState state(folder, {});
  EXPECT_TRUE(state.outlineOf(stage("a", 1)).empty());
  EXPECT_EQ(state.trouble(), "");
}

TEST_F(CaseStateTest, TheConfigurationHoldsUntilTheCaseSaysSomethingElse) {
  const CaseState::Configured configured{Eigen::Vector3d(0, -1, 0), {{"a", kRegions}, {"b", kRegions}}};
  {
    CaseState state(folder, configured);
    EXPECT_EQ(state.gravity()->source, "the parameter gravity");
    EXPECT_EQ(state.regionsOf(stage("a", 1)), kRegions);
    state.setGravity(Eigen::Vector3d(0, 0, -1), "the probe");
    state.forget("a");  // they were drawn on the stage that is gone
    state.exclude(stage("b", 2), {});
  }
  const CaseState state(folder, configured);
  EXPECT_EQ(state.gravity()->direction_pmr, Eigen::Vector3d(0, 0, -1));
  EXPECT_EQ(state.gravity()->source, "the probe; the parameter gravity, 90.0 degrees from it, does not count");
  EXPECT_TRUE(state.regionsOf(stage("a", 3)).empty());
  EXPECT_TRUE(state.regionsOf(stage("b", 2)).empty());
}

TEST_F(CaseStateTest, ADamagedFileIsSetAsideAndNamed) {
  const std::string good = "{\"format\": \"cortshift case state, version 1\", \"unit\": \"m\", \"gravity\": ";
  for (const std::string& text :
       {std::string("{\"format\": "), std::string("no JSON"), std::string("\0\0\0", 3), std::string("[]"),
        good + "{\"direction_pmr\": [0, 0, 0], \"source\": \"x\"}, \"excluded\": {}}", good + "null}",
        good + "{\"direction_pmr\": [0, .nan, 1], \"source\": \"x\"}, \"excluded\": {}}",
        good + "null, \"excluded\": {\"../a\": {\"stamp\": [1, 2], \"regions\": []}}}",
        good + "null, \"excluded\": {\"a\": {\"stamp\": [1, 2], \"regions\": [[[0, 0], [1, 1]]]}}}",
        good + "null, \"excluded\": {\"a\": {\"stamp\": [-1, 2], \"regions\": []}}}"}) {
    leave(text);
    CaseState state(folder, {});
    EXPECT_FALSE(state.gravity()) << text;
    EXPECT_TRUE(holds(state.trouble(), "case_state.json is damaged")) << text;
    EXPECT_TRUE(holds(state.trouble(), "set aside as ")) << text;
    EXPECT_FALSE(fs::exists(file())) << text;
    state.setGravity(kDown, "again");
    EXPECT_TRUE(fs::exists(file()));
    fs::remove(file());
  }
  EXPECT_EQ(std::distance(fs::directory_iterator(folder / "set_aside"), {}), 10);
}

TEST_F(CaseStateTest, WhatCannotBeReadIsNeitherGuessedNorOverwritten) {
  { CaseState(folder, {}).setGravity(kDown, "kept"); }
  const std::string before = readWhole(file());
  failing_disk::read_failure = EIO;
  CaseState state(folder, {Eigen::Vector3d(0, -1, 0), {}});
  EXPECT_TRUE(holds(refusal([&] { state.gravity(); }), "Input/output error"));
  EXPECT_TRUE(holds(refusal([&] { state.regionsOf(stage("a", 1)); }), "case_state.json"));
  EXPECT_TRUE(holds(refusal([&] { state.setGravity(Eigen::Vector3d(0, 0, 1), "new"); }), "case_state.json"));
  EXPECT_TRUE(holds(state.trouble(), "Input/output error"));
  failing_disk::read_failure = 0;
  EXPECT_EQ(readWhole(file()), before);
  EXPECT_EQ(state.gravity()->direction_pmr, kDown);
  EXPECT_EQ(state.trouble(), "");
}

TEST_F(CaseStateTest, AnotherVersionIsLeftAlone) {
  leave("{\"format\": \"cortshift case state, version 2\", \"unit\": \"m\", \"outline\": {}}");
  CaseState state(folder, {});
  EXPECT_TRUE(holds(state.trouble(), "\"cortshift case state, version 2\", which this software does not know"));
  EXPECT_FALSE(refusal([&] { state.setGravity(kDown, "new"); }).empty());
  EXPECT_TRUE(holds(readWhole(file()), "outline"));
}

TEST_F(CaseStateTest, AFullDiskChangesNothing) {
  CaseState state(folder, {});
  state.setGravity(kDown, "kept");
  const std::string before = readWhole(file());
  for (const long room : {0L, 10L, 100L}) {
    failing_disk::room = room;
    const std::string reason = refusal([&] { state.exclude(stage("a", 1), kRegions); });
    failing_disk::room = failing_disk::kUnlimited;
    EXPECT_TRUE(holds(reason, "No space left on device"));
    EXPECT_EQ(readWhole(file()), before);
    EXPECT_TRUE(state.regionsOf(stage("a", 1)).empty());
    EXPECT_EQ(std::distance(fs::directory_iterator(folder), {}), 1);
  }
  state.exclude(stage("a", 1), kRegions);
  EXPECT_EQ(state.regionsOf(stage("a", 1)), kRegions);
}

}  // namespace
}  // namespace cortshift_tracking

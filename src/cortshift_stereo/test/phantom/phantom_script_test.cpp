// What the YAML of a phantom case may say, and what is told where it is wrong.
#include <gmock/gmock.h>

#include "cortshift_stereo_phantom/phantom_cameras.hpp"
#include "cortshift_stereo_phantom/phantom_case.hpp"
#include "cortshift_stereo_phantom/phantom_scene.hpp"

namespace cortshift_stereo_phantom {
namespace {

std::string errorOf(const std::string& yaml) {
  try {
    parsePhantomCase(yaml, "test");
  } catch (const PhantomCaseError& error) {
    return error.what();
  }
  return "";
}

TEST(PhantomScript, minimalCaseTakesTheDefaults) {
  const PhantomCase minimal = parsePhantomCase("{name: m, stages: [{name: only}]}", "test");
  EXPECT_EQ(minimal.cameras.size, cv::Size(1024, 768));
  EXPECT_EQ(minimal.stages.at(0).name, "only");
}

TEST(PhantomScript, readsTheLens) {
  const PhantomCase wide = parsePhantomCase(
      "{name: m, cameras: {lens: equidistant, left_distortion: [0.1, 0, 0, 0], right_distortion: [0, 0.1, 0, 0]}, "
      "stages: [{name: only}]}",
      "test");
  EXPECT_EQ(wide.cameras.lens, cortshift_stereo::LensModel::kEquidistant);
  EXPECT_EQ(makeStereoHead(wide.cameras).model.right.D, std::vector<double>({0, 0.1, 0, 0}));
}

TEST(PhantomScript, refusesWhatIsWrongByName) {
  EXPECT_NE(errorOf("{name: m}").find("at least one stage"), std::string::npos);
  EXPECT_NE(errorOf("{stages: [{name: a}]}").find("name is missing"), std::string::npos);
  EXPECT_NE(errorOf("{name: m, colour: red, stages: [{name: a}]}").find("colour is unknown"), std::string::npos);
  EXPECT_NE(errorOf("{name: m, stages: [{name: a, deformation: {sagg: 1}}]}").find("stages[0].deformation.sagg"),
            std::string::npos);
  EXPECT_NE(errorOf("{name: m, stages: [{name: a}, {name: a}]}").find("taken"), std::string::npos);
  EXPECT_NE(errorOf("{name: m, stages: [{name: a, deformation: {sag: 6}}]}").find("sag = 6"), std::string::npos);
  EXPECT_NE(errorOf("{name: m, stages: [{name: a, deformation: {sag: .nan}}]}").find("sag = nan"), std::string::npos);
  EXPECT_NE(errorOf("{name: m, image: {noise: loud}, stages: [{name: a}]}").find("image.noise = loud"),
            std::string::npos);
  EXPECT_NE(errorOf("{name: m, cameras: {size: [3]}, stages: [{name: a}]}").find("list of 2"), std::string::npos);
  EXPECT_NE(errorOf("{name: m, brain_in_pmr: {rpy: [0, 0, 0]}, stages: [{name: a}]}").find("translation is missing"),
            std::string::npos);
  EXPECT_NE(errorOf("{name: m, gravity_in_pmr: [0, 0, 0], stages: [{name: a}]}").find("gravity_in_pmr"),
            std::string::npos);
  EXPECT_NE(errorOf("{name: m, cameras: {lens: fisheye}, stages: [{name: a}]}").find("cameras.lens is 'fisheye'"),
            std::string::npos);
  EXPECT_NE(errorOf("{name: m, cameras: {lens: equidistant}, stages: [{name: a}]}")
                .find("cameras.left_distortion has 5 values; equidistant has 4"),
            std::string::npos);
  EXPECT_NE(errorOf("{name: m, stages: [").find("not YAML"), std::string::npos);
  EXPECT_NE(errorOf("just text").find("mapping"), std::string::npos);
  EXPECT_THROW(loadPhantomCase("/nowhere/case.yaml"), PhantomCaseError);
}

TEST(PhantomScript, refusesAStageThatFoldsTheSurface) {
  PhantomCase folded = loadPhantomCase(CORTSHIFT_CONFIG_DIR "/phantom/phantom_case.yaml");
  folded.stages[0].deformation.lateral = {0.015, 0};
  EXPECT_THROW(PhantomScene{folded}, PhantomCaseError);
}

TEST(PhantomScript, unknownStageNamesThoseThatThereAre) {
  try {
    PhantomScene(loadPhantomCase(CORTSHIFT_CONFIG_DIR "/phantom/phantom_case.yaml")).stageIndex("later");
    FAIL();
  } catch (const PhantomCaseError& error) {
    EXPECT_NE(std::string(error.what()).find("dural_opening"), std::string::npos);
  }
}

}  // namespace
}  // namespace cortshift_stereo_phantom

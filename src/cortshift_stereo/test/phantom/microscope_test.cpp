// What the phantom's microscope does to its images, one thing at a time.
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <set>

#include "cortshift_stereo_phantom/phantom_renderer.hpp"
#include "scratch_folder.hpp"

namespace cortshift_stereo_phantom {
namespace {

namespace fs = std::filesystem;
using cortshift_stereo::ScratchFolder;

PhantomCase smallCase() {
  PhantomCase small;
  small.name = "small";
  small.cameras.size = {160, 120};
  small.cameras.field_of_view = 0.04;
  small.image.noise = 0;
  small.image.supersampling = 2;
  small.stages.resize(1);
  small.stages[0].name = "only";
  return small;
}

double sharpness(const cv::Mat& light) {
  cv::Mat grey, edges;
  cv::cvtColor(light, grey, cv::COLOR_BGR2GRAY);
  cv::Laplacian(grey, edges, CV_32F);
  cv::Scalar mean, deviation;
  cv::meanStdDev(edges, mean, deviation);
  return deviation[0];
}

cv::Mat exposed(const PhantomCase& description, const cv::Mat& light, Side side = Side::kLeft,
                std::uint64_t frame = 1) {
  return Sensor(description.image).expose(Sensor::prepare(light), frame, side);
}

TEST(PhantomMicroscope, aPictureLiesWhereItIsSpread) {
  const ScratchFolder folder;
  cv::Mat picture(100, 200, CV_8UC3, cv::Scalar(40, 80, 160));
  picture.colRange(100, 200).setTo(cv::Scalar(160, 80, 40));
  cv::imwrite(folder.file("halves.png"), picture);
  std::ofstream(folder.file("base.yaml")) << "{name: base, head: {seed: 3, sulcus_depth: 0}, stages: [{name: only}]}";
  std::ofstream(folder.file("case.yaml"))
      << "{based_on: base.yaml, name: pictured, head: {picture: {file: halves.png, width: 0.04}}}";
  const PhantomCase description = loadPhantomCase(folder.file("case.yaml"));
  EXPECT_EQ(description.name, "pictured");
  EXPECT_EQ(description.head.seed, 3u) << "what a case does not say holds as its base has it";
  const PhantomScene scene(description);
  const View view = scene.view(0, Side::kLeft);
  const cv::Mat light = renderView(scene, 0, view, 1);
  for (const double x : {-0.004, 0.004}) {
    const auto pixel = view.project(scene.pointAt(0, x, 0));
    ASSERT_TRUE(pixel);
    const auto colour =
        light.at<cv::Vec3f>(static_cast<int>(std::lround(pixel->y())), static_cast<int>(std::lround(pixel->x())));
    // Light is the same for the three channels: their ratio is the picture's.
    EXPECT_NEAR(colour[0] / colour[2], x < 0 ? 0.25 : 4.0, 0.02 * (x < 0 ? 0.25 : 4.0)) << x;
  }
}

TEST(PhantomMicroscope, aPictureThatIsNotThereIsRefusedByName) {
  PhantomCase description = smallCase();
  description.head.picture.emplace().file = "/nowhere.png";
  try {
    PhantomScene{description};
    FAIL();
  } catch (const PhantomCaseError& error) {
    EXPECT_NE(std::string(error.what()).find("head.picture.file = /nowhere.png"), std::string::npos) << error.what();
  }
}

TEST(PhantomMicroscope, depthOfFieldBlursAsFarAsTheFocalPlaneIsAway) {
  PhantomCase description = smallCase();
  description.stages[0].microscope.distance = 0.300;
  const double sharp = sharpness(sensorLight(PhantomScene(description), 0, Side::kLeft));
  description.image.depth_of_field = 0.3;
  const double focused = sharpness(sensorLight(PhantomScene(description), 0, Side::kLeft));
  description.image.focus_offset = 0.010;
  const double away = sharpness(sensorLight(PhantomScene(description), 0, Side::kLeft));
  EXPECT_GT(focused, 0.35 * sharp);
  EXPECT_LT(away, 0.3 * focused);
}

TEST(PhantomMicroscope, glintsOfTheFilmLieElsewhereForEachCameraAndPose) {
  PhantomCase description = smallCase();
  description.light.position_head = {0, 0, 0};
  PhantomCase wet = description;
  wet.light.film.emplace();
  const auto glints = [&](const PhantomCase& of, const PhantomCase& without, Side side) {
    const PhantomScene scene(of), dry(without);
    const View view = scene.rectified(0, side);
    cv::Mat gained;
    cv::extractChannel(renderView(scene, 0, view, 1) - renderView(dry, 0, view, 1), gained, 0);
    const ViewTruth truth = truthOf(scene, 0, view);
    // The material points that shine, on a grid of 0.5 mm.
    std::set<std::pair<int, int>> places;
    for (int y = 0; y < gained.rows; ++y)
      for (int x = 0; x < gained.cols; ++x)
        if (gained.at<float>(y, x) > 0.5f) {
          const auto& m = truth.material.at<cv::Vec2d>(y, x);
          places.emplace(static_cast<int>(std::floor(m[0] / 5e-4)), static_cast<int>(std::floor(m[1] / 5e-4)));
        }
    return places;
  };
  const auto shared = [](const std::set<std::pair<int, int>>& a, const std::set<std::pair<int, int>>& b) {
    std::size_t count = 0;
    for (const auto& place : a) count += b.count(place);
    return static_cast<double>(count) / static_cast<double>(a.size());
  };
  const auto left = glints(wet, description, Side::kLeft), right = glints(wet, description, Side::kRight);
  ASSERT_GT(left.size(), 20u);
  ASSERT_GT(right.size(), 20u);
  EXPECT_LT(shared(left, right), 0.8);
  wet.stages[0].microscope.tilt = description.stages[0].microscope.tilt = {0.1, 0.05};
  EXPECT_LT(shared(left, glints(wet, description, Side::kLeft)), 0.5);
}

TEST(PhantomMicroscope, camerasRespondAsTheyAreSet) {
  PhantomCase description = smallCase();
  const cv::Mat light = sensorLight(PhantomScene(description), 0, Side::kRight);
  description.image.right.white_balance = {1.1, 1.0, 0.9};
  description.image.right.gain = 0.8;
  const cv::Mat changed = sensorLight(PhantomScene(description), 0, Side::kRight);
  const cv::Vec3f was = light.at<cv::Vec3f>(60, 80), is = changed.at<cv::Vec3f>(60, 80);
  EXPECT_NEAR(is[0] / was[0], 0.88, 1e-4);
  EXPECT_NEAR(is[1] / was[1], 0.80, 1e-4);
  EXPECT_NEAR(is[2] / was[2], 0.72, 1e-4);
  description.image.right.blur = 1.5;
  EXPECT_LT(sharpness(sensorLight(PhantomScene(description), 0, Side::kRight)), 0.5 * sharpness(changed));
  EXPECT_EQ(cv::norm(sensorLight(PhantomScene(description), 0, Side::kLeft),
                     sensorLight(PhantomScene(smallCase()), 0, Side::kLeft), cv::NORM_INF),
            0);
}

TEST(PhantomMicroscope, blackLevelAndShotNoiseFollowTheSignal) {
  PhantomCase description = smallCase();
  description.image.right.black_level = 10.0 / 255;
  description.image.shot_noise = 8.0 / 255;
  const cv::Mat dark(200, 200, CV_32FC3, cv::Scalar::all(0)), middle(200, 200, CV_32FC3, cv::Scalar::all(0.25));
  cv::Scalar mean, deviation;
  cv::meanStdDev(exposed(description, dark, Side::kRight).reshape(1), mean, deviation);
  EXPECT_NEAR(mean[0], 10, 1e-9);
  EXPECT_NEAR(deviation[0], 0, 1e-9);
  cv::meanStdDev(exposed(description, middle, Side::kRight).reshape(1), mean, deviation);
  EXPECT_NEAR(mean[0], 10 + 0.25 * 255, 0.1);
  EXPECT_NEAR(deviation[0], 4, 0.15) << "half of full scale's at a quarter of its light";
}

TEST(PhantomMicroscope, aMosaicKeepsColoursAndLosesDetail) {
  PhantomCase description = smallCase();
  description.image.bayer = true;
  const cv::Mat even(60, 80, CV_32FC3, cv::Scalar(0.2, 0.5, 0.7));
  const cv::Mat image = exposed(description, even);
  EXPECT_EQ(image.at<cv::Vec3b>(30, 40), cv::Vec3b(51, 128, 179));
  cv::Mat stripes(60, 80, CV_32FC3, cv::Scalar::all(0.2));
  for (int x = 0; x < stripes.cols; x += 2) stripes.col(x).setTo(cv::Scalar::all(0.8));
  EXPECT_GT(cv::norm(exposed(description, stripes), exposed(smallCase(), stripes), cv::NORM_L1) / (3.0 * 60 * 80), 20);
}

TEST(PhantomMicroscope, compressionChangesALittle) {
  PhantomCase description = smallCase();
  const cv::Mat light = sensorLight(PhantomScene(description), 0, Side::kLeft);
  const cv::Mat before = exposed(description, light);
  description.image.jpeg = 85;
  const double change =
      cv::norm(before, exposed(description, light), cv::NORM_L1) / (3.0 * static_cast<double>(light.total()));
  EXPECT_GT(change, 0.3);
  EXPECT_LT(change, 8);
}

TEST(PhantomMicroscope, theBrainPulsesBetweenThePairsAndTheTruthWithIt) {
  PhantomCase description = smallCase();
  description.motion.pulsation = 0.0003;
  description.motion.pulsation_rate = 1.25;
  description.motion.pair_interval = 0.2;  // a quarter of a beat
  const auto scene = std::make_shared<const PhantomScene>(description);
  PhantomPairs pairs(scene);
  EXPECT_EQ(pairs.sceneAt(0).get(), scene.get());
  const Eigen::Vector3d outwards = description.T_pmr_brain.linear().col(2);
  const double rise = (pairs.sceneAt(1)->pointAt(0, 0, 0) - scene->pointAt(0, 0, 0)).dot(outwards);
  EXPECT_NEAR(rise, 0.0003, 1e-9);
  EXPECT_NEAR((pairs.sceneAt(3)->pointAt(0, 0, 0) - scene->pointAt(0, 0, 0)).dot(outwards), -0.0003, 1e-9);
  EXPECT_GT(cv::norm(pairs.take(0, 0).left, pairs.take(0, 1).left, cv::NORM_L1), 0);
  EXPECT_EQ(cv::norm(pairs.take(0, 0).left, pairs.take(0, 4).left, cv::NORM_INF), 0);
}

TEST(PhantomMicroscope, aRodHidesTissueAndCastsAShadow) {
  PhantomCase description = smallCase();
  description.light.position_head = {0, -0.060, 0};  // aslant, so that the shadow shows beside the rod
  const PhantomScene empty(description);
  description.stages[0].rods.push_back({{0.0, 0.0, 0.006}, 0.3, 0.3, 0.004, 0.05});
  const PhantomScene scene(description);
  const View view = scene.view(0, Side::kLeft);
  const ViewTruth truth = truthOf(scene, 0, view);
  const cv::Mat rod = truth.what == static_cast<int>(Material::kRetractor);
  EXPECT_GT(cv::countNonZero(rod), 200);
  // The rod's surface lies a radius from its axis.
  const Eigen::Isometry3d T_brain_pmr = description.T_pmr_brain.inverse();
  const double c = std::cos(0.3), s = std::sin(0.3);
  const Eigen::Vector3d along(c * c, s * c, s), start = Eigen::Vector3d(0, 0, 0.006) + 0.002 * along;
  for (int y = 0; y < rod.rows; ++y)
    for (int x = 0; x < rod.cols; ++x) {
      if (!rod.at<uchar>(y, x)) continue;
      const auto& p = truth.points_pmr.at<cv::Vec3d>(y, x);
      const Eigen::Vector3d from = T_brain_pmr * Eigen::Vector3d(p[0], p[1], p[2]) - start;
      const double place = std::clamp(from.dot(along), 0.0, 0.05 - 0.004);
      ASSERT_NEAR((from - place * along).norm(), 0.002, 1e-9);
      // The slow and independent ray says the same.
      if (x % 9 == 0 && y % 9 == 0) {
        const auto hit = scene.castRay(0, view.T_pmr_camera.translation(),
                                       view.T_pmr_camera.linear() * view.direction(x, y).homogeneous());
        ASSERT_TRUE(hit && hit->what == Material::kRetractor);
        ASSERT_LT((hit->point_pmr - Eigen::Vector3d(p[0], p[1], p[2])).norm(), 1e-9);
      }
    }
  cv::Mat with, without, darker;
  cv::cvtColor(renderView(scene, 0, view, 1), with, cv::COLOR_BGR2GRAY);
  cv::cvtColor(renderView(empty, 0, view, 1), without, cv::COLOR_BGR2GRAY);
  darker = (with < 0.8 * without) & ~rod;
  EXPECT_GT(cv::countNonZero(darker), 50);
}

TEST(PhantomMicroscope, theSetsDoNotShareTheirPicturesPosesOrSeeds) {
  const fs::path folder = fs::path(CORTSHIFT_CONFIG_DIR) / "phantom";
  std::set<std::string> pictures;
  std::set<std::uint32_t> seeds;
  std::set<double> rolls;
  for (const char* set : {"fit", "choose", "judge"}) {
    std::set<std::string> own;
    int cases = 0;
    for (const auto& entry : fs::directory_iterator(folder / set)) {
      const PhantomCase description = loadPhantomCase(entry.path());
      ASSERT_TRUE(description.head.picture) << entry.path();
      EXPECT_TRUE(fs::exists(description.head.picture->file)) << description.head.picture->file;
      EXPECT_EQ(description.stages.size(), 3u);
      own.insert(description.head.picture->file);
      ++cases;
    }
    EXPECT_EQ(cases, 10) << set;
    const PhantomCase base = loadPhantomCase((folder / set / "photograph.yaml"));
    for (const std::string& picture : own) EXPECT_TRUE(pictures.insert(picture).second) << picture;
    EXPECT_TRUE(seeds.insert(base.head.seed).second);
    for (const auto& stage : base.stages) EXPECT_TRUE(rolls.insert(stage.microscope.roll).second) << set;
  }
}

}  // namespace
}  // namespace cortshift_stereo_phantom

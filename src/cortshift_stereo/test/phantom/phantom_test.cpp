// The phantom against second methods: its truth must be true to a micrometre.
#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/calib3d.hpp>
#include <random>

#include "cortshift_stereo_phantom/phantom_renderer.hpp"

namespace cortshift_stereo_phantom {
namespace {

constexpr double kMicrometre = 1e-6;

const PhantomScene& demoScene() {
  static const PhantomScene scene(loadPhantomCase(CORTSHIFT_CONFIG_DIR "/phantom/phantom_case.yaml"));
  return scene;
}

const PhantomScene& theatreScene() {
  static const PhantomScene scene(loadPhantomCase(CORTSHIFT_CONFIG_DIR "/phantom/phantom_theatre.yaml"));
  return scene;
}

Eigen::Vector3d toEigen(const cv::Vec3d& v) { return {v[0], v[1], v[2]}; }

/// Projects with OpenCV, which shares no code with the phantom.
Eigen::Vector2d projectWithOpenCv(const View& view, const Eigen::Vector3d& point_pmr) {
  const Eigen::Vector3d p = view.T_pmr_camera.inverse() * point_pmr;
  const std::vector<cv::Point3d> point{{p.x(), p.y(), p.z()}};
  const cv::Vec3d none(0, 0, 0);
  std::vector<cv::Point2d> pixel;
  if (view.lens == cortshift_stereo::LensModel::kEquidistant)
    cv::fisheye::projectPoints(point, pixel, none, none, view.K, view.D);
  else
    cv::projectPoints(point, none, none, view.K, view.D, pixel);
  return {pixel[0].x, pixel[0].y};
}

/// Truth of the pixels of one view, checked at `samples` random pixels against projection and against ray marching.
void expectTruthExact(const PhantomScene& scene, int stage, const View& view, int samples) {
  const ViewTruth truth = truthOf(scene, stage, view);
  std::mt19937 random(42);
  int compared = 0;
  for (int i = 0; i < samples; ++i) {
    const int column = static_cast<int>(random() % static_cast<unsigned>(view.size.width));
    const int row = static_cast<int>(random() % static_cast<unsigned>(view.size.height));
    const Eigen::Vector3d point = toEigen(truth.points_pmr.at<cv::Vec3d>(row, column));
    ASSERT_TRUE(point.allFinite()) << column << ", " << row;
    const Eigen::Vector2d pixel = projectWithOpenCv(view, point);
    EXPECT_NEAR(pixel.x(), column, 1e-7);
    EXPECT_NEAR(pixel.y(), row, 1e-7);

    const Eigen::Vector3d eye = view.T_pmr_camera.translation();
    const Eigen::Vector3d ray = view.T_pmr_camera.linear() * view.direction(column, row).homogeneous();
    const auto hit = scene.castRay(stage, eye, ray);
    ASSERT_TRUE(hit.has_value());
    EXPECT_LT((hit->point_pmr - point).norm(), 0.01 * kMicrometre)
        << "stage " << stage << " at " << column << ", " << row;
    const auto what = static_cast<Material>(truth.what.at<uchar>(row, column));
    EXPECT_EQ(static_cast<int>(hit->what), static_cast<int>(what));
    if (what == Material::kRetractor) continue;
    const cv::Vec2d m = truth.material.at<cv::Vec2d>(row, column);
    EXPECT_LT((scene.pointAt(stage, m[0], m[1]) - point).norm(), 1e-3 * kMicrometre);
    ++compared;
  }
  EXPECT_GT(compared, samples / 2);
}

TEST(PhantomTruth, agreesWithRayMarchingAndProjectionOnEveryStage) {
  for (int stage = 0; stage < demoScene().stageCount(); ++stage)
    for (const Side side : {Side::kLeft, Side::kRight})
      expectTruthExact(demoScene(), stage, demoScene().view(stage, side), 1500);
}

TEST(PhantomTruth, holdsForRectifiedViews) {
  expectTruthExact(demoScene(), 2, demoScene().rectified(2, Side::kLeft), 1500);
}

TEST(PhantomTruth, seesTheNearestSheetBesideHoleAndRetractor) {
  for (int stage = 1; stage < theatreScene().stageCount(); ++stage)
    expectTruthExact(theatreScene(), stage, theatreScene().view(stage, Side::kRight), 1500);
}

TEST(PhantomTruth, seesTheNearestSheetWhereOneHidesAnother) {
  // Pixels beside a jump in the material coordinates: there the surface hides a part of itself.
  PhantomCase steep = theatreScene().description();
  steep.stages.erase(steep.stages.begin(), steep.stages.end() - 1);
  steep.stages[0].hole->wall = 0.0015;
  steep.stages[0].microscope.tilt = {0.25, -0.2};
  const PhantomScene scene(steep);
  const View view = scene.view(0, Side::kLeft);
  const ViewTruth truth = truthOf(scene, 0, view);
  int compared = 0, wrong = 0;
  for (int row = 1; row + 1 < view.size.height; ++row)
    for (int column = 1; column + 1 < view.size.width; ++column) {
      const cv::Vec2d here = truth.material.at<cv::Vec2d>(row, column);
      constexpr double kJump = 0.0008;  // ten pixels' worth [m]
      if (!(cv::norm(here - truth.material.at<cv::Vec2d>(row, column + 1)) > kJump) &&
          !(cv::norm(here - truth.material.at<cv::Vec2d>(row + 1, column)) > kJump))
        continue;
      const Eigen::Vector3d ray = view.T_pmr_camera.linear() * view.direction(column, row).homogeneous();
      const auto hit = scene.castRay(0, view.T_pmr_camera.translation(), ray);
      ASSERT_TRUE(hit.has_value());
      ++compared;
      wrong += (hit->point_pmr - toEigen(truth.points_pmr.at<cv::Vec3d>(row, column))).norm() > kMicrometre;
    }
  EXPECT_GT(compared, 100);
  EXPECT_EQ(wrong, 0) << "of " << compared;
}

TEST(PhantomTruth, everyMaterialOfTheTheatreIsSeen) {
  const PhantomScene& scene = theatreScene();
  const auto share = [&](const std::string& stage_name, Material what) {
    const int stage = scene.stageIndex(stage_name);
    const ViewTruth truth = truthOf(scene, stage, scene.view(stage, Side::kLeft));
    const int rim = cv::countNonZero(truth.what == static_cast<int>(Material::kRim));
    return static_cast<double>(cv::countNonZero(truth.what == static_cast<int>(what))) /
           static_cast<double>(truth.what.total() - static_cast<std::size_t>(rim));
  };
  EXPECT_GT(share("bleeding", Material::kBlood), 0.10);
  EXPECT_GT(share("after_resection", Material::kHole), 0.18);
  EXPECT_GT(share("retractor_in", Material::kRetractor), 0.05);
  EXPECT_GT(share("dural_opening", Material::kBrain), 0.999);
}

TEST(PhantomSurface, tangentsAgreeWithFiniteDifferences) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> place(-0.033, 0.033);
  constexpr double kStep = 1e-6;
  for (const PhantomScene* scene : {&demoScene(), &theatreScene()})
    for (int stage = PhantomScene::kUndeformed; stage < scene->stageCount(); ++stage)
      for (int i = 0; i < 300; ++i) {
        const double x = place(random), y = place(random);
        const SurfaceSample s = scene->sample(stage, x, y);
        const Eigen::Vector3d dx =
            (scene->sample(stage, x + kStep, y).point - scene->sample(stage, x - kStep, y).point) / (2 * kStep);
        const Eigen::Vector3d dy =
            (scene->sample(stage, x, y + kStep).point - scene->sample(stage, x, y - kStep).point) / (2 * kStep);
        EXPECT_LT((dx - s.along_x).norm(), 1e-4) << "stage " << stage << " at " << x << ", " << y;
        EXPECT_LT((dy - s.along_y).norm(), 1e-4) << "stage " << stage << " at " << x << ", " << y;
      }
}

TEST(PhantomSurface, rimNeverMoves) {
  for (int i = 0; i < 360; ++i) {
    const double angle = i * 0.0174533;
    for (double r = 0.015; r < 0.05; r += 0.001) {
      const double x = r * std::cos(angle), y = r * std::sin(angle);
      if (demoScene().rimDistance(x, y) > 0) continue;
      EXPECT_EQ(demoScene().displacement(0, 2, x, y).norm(), 0.0);
    }
  }
}

TEST(PhantomSurface, demoCaseMovesAsFarAsItPromises) {
  const PhantomScene& scene = demoScene();
  const Eigen::Vector3d moved = scene.displacement(0, 2, 0, 0), gravity = scene.description().gravity_pmr;
  const Eigen::Vector3d outwards = scene.description().T_pmr_brain.linear().col(2);
  EXPECT_GT(moved.dot(gravity), 0.006);
  EXPECT_GT((moved - moved.dot(outwards) * outwards).norm(), 0.002);
}

TEST(PhantomSurface, displacementIsTheDifferenceOfThePointsSeen) {
  // A pixel of stage 0 and the place where the same material is at stage 2, found by inverting the later surface.
  const PhantomScene& scene = demoScene();
  const ViewTruth truth = truthOf(scene, 0, scene.rectified(0, Side::kLeft));
  int compared = 0;
  for (int row = 20; row < truth.what.rows; row += 61)
    for (int column = 20; column < truth.what.cols; column += 61) {
      const cv::Vec2d m = truth.material.at<cv::Vec2d>(row, column);
      const Eigen::Vector3d start = toEigen(truth.points_pmr.at<cv::Vec3d>(row, column));
      const Eigen::Vector3d end = start + scene.displacement(0, 2, m[0], m[1]);
      const auto back = scene.materialOf(end, 2);
      ASSERT_TRUE(back.has_value());
      EXPECT_LT(std::abs(back->distance), 0.001 * kMicrometre);
      EXPECT_NEAR(back->material.x(), m[0], 0.01 * kMicrometre);
      EXPECT_NEAR(back->material.y(), m[1], 0.01 * kMicrometre);
      ++compared;
    }
  EXPECT_GT(compared, 150);
}

TEST(PhantomSurface, nearestPointGivesTheHeightError) {
  const PhantomScene& scene = demoScene();
  std::mt19937 random(3);
  std::uniform_real_distribution<double> place(-0.02, 0.02), height(-0.0001, 0.0001);
  for (int i = 0; i < 500; ++i) {
    const double x = place(random), y = place(random), h = height(random);
    const Eigen::Vector3d p = scene.pointAt(1, x, y) + h * scene.normalAt(1, x, y);
    const auto found = scene.materialOf(p, 1);
    ASSERT_TRUE(found.has_value());
    EXPECT_NEAR(found->distance, h, 0.01 * kMicrometre);
    EXPECT_NEAR(found->material.x(), x, 0.1 * kMicrometre);
    EXPECT_NEAR(found->material.y(), y, 0.1 * kMicrometre);
  }
  EXPECT_FALSE(scene.materialOf(scene.pointAt(1, 0, 0) + 0.01 * scene.normalAt(1, 0, 0), 1).has_value());
}

TEST(PhantomSurface, visibilityAgreesWithWhatTheViewShows) {
  const PhantomScene& scene = theatreScene();
  const int stage = scene.stageIndex("retractor_in");
  const View view = scene.view(stage, Side::kLeft);
  const ViewTruth truth = truthOf(scene, stage, view);
  int hidden = 0, seen = 0;
  for (double x = -0.02; x < 0.02; x += 0.0017)
    for (double y = -0.02; y < 0.02; y += 0.0017) {
      const auto pixel = view.project(scene.pointAt(stage, x, y));
      ASSERT_TRUE(pixel.has_value());
      const cv::Point at(static_cast<int>(std::lround(pixel->x())), static_cast<int>(std::lround(pixel->y())));
      if (at.x < 3 || at.y < 3 || at.x > view.size.width - 4 || at.y > view.size.height - 4) continue;
      const cv::Mat around = truth.what(cv::Rect(at - cv::Point(2, 2), cv::Size(5, 5)));
      const int blade = cv::countNonZero(around == static_cast<int>(Material::kRetractor));
      if (blade == 25) {
        EXPECT_FALSE(scene.isVisible(stage, x, y, view));
        ++hidden;
      } else if (blade == 0 && scene.isVisible(stage, x, y, view)) {
        const cv::Vec2d m = truth.material.at<cv::Vec2d>(at);
        EXPECT_LT(std::hypot(m[0] - x, m[1] - y), 0.0005);
        ++seen;
      }
    }
  EXPECT_GT(hidden, 10);
  EXPECT_GT(seen, 200);
}

TEST(PhantomCameras, rectifiedRowsAgreeAndTriangulateToTheSamePoint) {
  const PhantomScene& scene = demoScene();
  const auto& model = scene.stereoHead().model;
  EXPECT_GT(std::abs(model.left.P(0, 2) - model.right.P(0, 2)), 100);  // verging
  const int stage = 1;
  const View left = scene.rectified(stage, Side::kLeft), right = scene.rectified(stage, Side::kRight);
  std::mt19937 random(5);
  std::uniform_real_distribution<double> place(-0.03, 0.03);
  for (int i = 0; i < 1000; ++i) {
    const Eigen::Vector3d point = scene.pointAt(stage, place(random), place(random));
    const Eigen::Vector2d l = projectWithOpenCv(left, point), r = projectWithOpenCv(right, point);
    EXPECT_NEAR(l.y(), r.y(), 1e-9);
    const double z = cortshift_stereo::depthOfDisparity(model, l.x() - r.x());
    const Eigen::Vector3d p_rectified((l.x() - model.left.P(0, 2)) * z / model.left.P(0, 0),
                                      (l.y() - model.left.P(1, 2)) * z / model.left.P(1, 1), z);
    // Back to the raw left camera through R', then to pmr.
    const Eigen::Matrix3d R = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(model.left.R.val);
    const Eigen::Vector3d p_left = R.transpose() * p_rectified;
    EXPECT_LT((scene.view(stage, Side::kLeft).T_pmr_camera * p_left - point).norm(), 0.01 * kMicrometre);
  }
}

TEST(PhantomCameras, everyLensIsExact) {
  for (const auto& [lens, D] :
       {std::pair(cortshift_stereo::LensModel::kRationalPolynomial,
                  std::vector<double>{0.5, -0.7, 0.002, -0.001, 0.2, 0.8, -0.4, 0.1}),
        std::pair(cortshift_stereo::LensModel::kEquidistant, std::vector<double>{-0.2, 0.3, -0.1, 0.05})}) {
    PhantomCase wide = demoScene().description();
    wide.cameras.lens = lens;
    wide.cameras.left_distortion = wide.cameras.right_distortion = D;
    const PhantomScene scene(wide);
    expectTruthExact(scene, 1, scene.view(1, Side::kLeft), 200);
    expectTruthExact(scene, 1, scene.view(1, Side::kRight), 200);
  }
}

TEST(PhantomCameras, rawAndRectifiedPixelsAgreeThroughOpenCv) {
  const PhantomScene& scene = demoScene();
  const auto& model = scene.stereoHead().model;
  for (const Side side : {Side::kLeft, Side::kRight}) {
    const auto& camera = side == Side::kLeft ? model.left : model.right;
    const Eigen::Vector3d point = scene.pointAt(0, 0.011, -0.007);
    const Eigen::Vector2d raw = projectWithOpenCv(scene.view(0, side), point);
    std::vector<cv::Point2d> rectified;
    cv::undistortPoints(std::vector<cv::Point2d>{{raw.x(), raw.y()}}, rectified, camera.K, camera.D, camera.R, camera.P,
                        cv::TermCriteria(cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 100, 1e-14));
    const Eigen::Vector2d expected = projectWithOpenCv(scene.rectified(0, side), point);
    EXPECT_NEAR(rectified[0].x, expected.x(), 1e-6);
    EXPECT_NEAR(rectified[0].y, expected.y(), 1e-6);
  }
}

TEST(PhantomCameras, baselineOfTheRightCameraMatchesItsPose) {
  const StereoHead& head = demoScene().stereoHead();
  EXPECT_NEAR(head.model.baseline(), head.T_left_right().translation().norm(), 1e-12);
  EXPECT_NEAR(head.model.baseline(), 0.025, 1e-12);
}

PhantomCase smallCase() {
  PhantomCase small = demoScene().description();
  small.cameras.size = {160, 120};
  small.image.noise = 2.0 / 255;
  return small;
}

TEST(PhantomImages, oneAndTwoThreadsGiveTheSameBits) {
  const auto scene = std::make_shared<const PhantomScene>(smallCase());
  const int threads = cv::getNumThreads();
  cv::setNumThreads(1);
  const StereoImages one = PhantomPairs(scene).take(1, 7);
  cv::setNumThreads(2);
  const StereoImages two = PhantomPairs(scene).take(1, 7);
  cv::setNumThreads(threads);
  EXPECT_EQ(cv::norm(one.left, two.left, cv::NORM_INF), 0);
  EXPECT_EQ(cv::norm(one.right, two.right, cv::NORM_INF), 0);
}

TEST(PhantomImages, noiseHasTheStatedStrengthAndIsFreshInEveryFrame) {
  const auto scene = std::make_shared<const PhantomScene>(smallCase());
  PhantomPairs pairs(scene);
  const StereoImages a = pairs.take(0, 1), b = pairs.take(0, 2), again = pairs.take(0, 1);
  EXPECT_EQ(cv::norm(a.left, again.left, cv::NORM_INF), 0);
  cv::Mat first, second;
  a.left.convertTo(first, CV_32F);
  b.left.convertTo(second, CV_32F);
  cv::Scalar mean, deviation;
  cv::meanStdDev((first - second).operator cv::Mat().reshape(1), mean, deviation);
  // Two independent noises of 2 levels and two roundings (1/12 each).
  EXPECT_NEAR(deviation[0], std::sqrt(2 * (4.0 + 1.0 / 12)), 0.1);
  EXPECT_NEAR(mean[0], 0, 0.05);
}

TEST(PhantomImages, supersamplingConvergesAndTheImageIsWellExposed) {
  const PhantomScene scene(smallCase());
  const View view = scene.view(0, Side::kLeft);
  const cv::Mat fine = renderView(scene, 0, view, 8), medium = renderView(scene, 0, view, 4);
  EXPECT_LT(cv::norm(fine, medium, cv::NORM_L1) / (3.0 * fine.total()), 0.02);
  double low, high;
  cv::minMaxLoc(fine.reshape(1), &low, &high);
  EXPECT_LT(high, 1.0);
  EXPECT_GT(cv::mean(fine)[2], 0.4);
}

TEST(PhantomImages, gainAndVignetteScaleTheLight) {
  PhantomCase bright = smallCase();
  const PhantomScene plain(bright);
  bright.stages[0].gain = 1.1;
  bright.image.vignette = 0.3;
  const PhantomScene changed(bright);
  const cv::Mat a = renderView(plain, 0, plain.view(0, Side::kLeft), 1);
  const cv::Mat b = renderView(changed, 0, changed.view(0, Side::kLeft), 1);
  EXPECT_NEAR(b.at<cv::Vec3f>(60, 80)[1] / a.at<cv::Vec3f>(60, 80)[1], 1.1, 1e-3);
  EXPECT_NEAR(b.at<cv::Vec3f>(0, 0)[1] / a.at<cv::Vec3f>(0, 0)[1], 1.1 * 0.7, 0.01);
}

TEST(PhantomImages, highlightsSaturateAndMoveBetweenTheViews) {
  PhantomCase wet = smallCase();
  wet.light.specular = 2.0;
  const PhantomScene scene(wet);
  const cv::Mat left = renderView(scene, 0, scene.view(0, Side::kLeft), 2);
  const cv::Mat dry = renderView(demoScene(), 0, scene.view(0, Side::kLeft), 2);
  cv::Mat gained;
  cv::extractChannel(left - dry, gained, 0);
  const int shining = cv::countNonZero(gained > 0.5);
  EXPECT_GT(shining, 20);
  EXPECT_LT(shining, static_cast<int>(left.total()) / 10);
}

}  // namespace
}  // namespace cortshift_stereo_phantom

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}

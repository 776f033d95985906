// Optical flow between two image files.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <exception>
#include <opencv2/imgcodecs.hpp>
#include <stdexcept>
#include <string>
#include <vector>

#include "cortshift_flow/flo_file.hpp"
#include "cortshift_flow/flow.hpp"

namespace {

constexpr char kUsage[] =
    "usage: flow_pair FIRST SECOND OUT.flo [--mask M.png] [--confidence C.png] [--settings F.yaml] [--threads N]\n"
    "\n"
    "Dense optical flow from image FIRST to image SECOND (same size and type), written as a Middlebury .flo in "
    "pixels.\n"
    "Prints flow_seconds: the time of the flow alone, images in memory.\n"
    "\n"
    "  --mask M.png        8-bit, size of the images: pixels of FIRST that are 0 are excluded\n"
    "  --confidence C.png  write the confidence 0...1 as 8-bit 0...255 (128: 0.25 px of error expected)\n"
    "  --settings F.yaml   settings, e.g. 'preset: fast' (presets: default, fast, ji2014)\n"
    "  --threads N         worker threads (default: all); the result does not depend on it\n"
    "\n"
    "Exit: 0 done, 1 failed, 2 bad usage.\n";

struct BadUsage : std::runtime_error {
  using std::runtime_error::runtime_error;
};

struct Arguments {
  std::string first, second, out, mask, confidence, settings;
  int threads = -1;  // not given
  bool help = false;
};

int parseThreads(const std::string& text) {
  std::size_t used = 0;
  int threads = 0;
  try {
    threads = std::stoi(text, &used);
  } catch (const std::exception&) {
    used = 0;
  }
  if (used == 0 || used != text.size() || threads < 1 || threads > 256)
    throw BadUsage("--threads " + text + " is not a number from 1 to 256");
  return threads;
}

Arguments parse(const std::vector<std::string>& words) {
  Arguments arguments;
  std::vector<std::string> files;
  for (std::size_t i = 0; i < words.size(); ++i) {
    const std::string& word = words[i];
    if (word == "--help" || word == "-h") {
      arguments.help = true;
      return arguments;
    }
    if (word.rfind("--", 0) != 0) {
      files.push_back(word);
      continue;
    }
    if (word != "--mask" && word != "--confidence" && word != "--settings" && word != "--threads")
      throw BadUsage("unknown option " + word);
    if (i + 1 == words.size()) throw BadUsage(word + " needs a value");
    const std::string& value = words[++i];
    if (word == "--mask") arguments.mask = value;
    if (word == "--confidence") arguments.confidence = value;
    if (word == "--settings") arguments.settings = value;
    if (word == "--threads") arguments.threads = parseThreads(value);
  }
  if (files.size() != 3)
    throw BadUsage("FIRST, SECOND and OUT.flo are needed, " + std::to_string(files.size()) + " given");
  arguments.first = files[0];
  arguments.second = files[1];
  arguments.out = files[2];
  return arguments;
}

cv::Mat load(const std::string& path, int flags) {
  cv::Mat image = cv::imread(path, flags);
  if (image.empty()) throw std::runtime_error("cannot read an image from " + path);
  return image;
}

/// Colour or grey as stored, 8 or 16 bit; an alpha channel is dropped.
cv::Mat loadImage(const std::string& path) { return load(path, cv::IMREAD_ANYDEPTH | cv::IMREAD_COLOR); }

void run(const Arguments& arguments) {
  cortshift_flow::FlowSettings settings;
  if (!arguments.settings.empty()) settings = cortshift_flow::readSettings(arguments.settings);
  if (arguments.threads > 0) settings.threads = arguments.threads;
  if (settings.threads > 0) cv::setNumThreads(settings.threads);
  const cv::Mat first = loadImage(arguments.first), second = loadImage(arguments.second);
  cv::Mat mask;
  if (!arguments.mask.empty()) mask = load(arguments.mask, cv::IMREAD_GRAYSCALE);

  const auto start = std::chrono::steady_clock::now();
  const cortshift_flow::FlowResult result = cortshift_flow::computeFlow(first, second, mask, settings);
  const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - start;

  cortshift_flow::writeFlo(arguments.out, result.flow);
  if (!arguments.confidence.empty()) {
    cv::Mat bytes;
    result.confidence.convertTo(bytes, CV_8U, 255.0);
    if (!cv::imwrite(arguments.confidence, bytes)) throw std::runtime_error("cannot write " + arguments.confidence);
  }
  std::printf("flow_seconds: %.6f\n", seconds.count());
}

}  // namespace

int main(int argc, char** argv) {
  Arguments arguments;
  try {
    arguments = parse({argv + 1, argv + argc});
  } catch (const BadUsage& error) {
    std::fprintf(stderr, "flow_pair: %s\n%s", error.what(), kUsage);
    return 2;
  }
  if (arguments.help) {
    std::fputs(kUsage, stdout);
    return 0;
  }
  try {
    run(arguments);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "flow_pair: %s\n", error.what());
    return 1;
  }
  return 0;
}

// Writes the images, the truth and the masks of one phantom case.
#include <cstdio>
#include <cstring>
#include <exception>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <stdexcept>
#include <string>

#include "cortshift_flow/flo_file.hpp"
#include "cortshift_flow_phantom/phantom_cases.hpp"

namespace {

constexpr char kUsage[] =
    "usage: make_phantom CASE DIRECTORY [SEED]\n"
    "Writes first.png, second.png, truth.flo, craniotomy.png, core.png, patch.png and blood.png of a phantom case\n"
    "into an existing directory. SEED (default 1) chooses another cortex. Exit: 0 done, 1 failed, 2 bad usage.\n"
    "Cases:";

void printUsage(std::FILE* to) {
  std::fputs(kUsage, to);
  for (const std::string& name : cortshift_flow_phantom::phantomCaseNames()) std::fprintf(to, " %s", name.c_str());
  std::fputs("\n", to);
}

void save(const std::string& path, const cv::Mat& image) {
  if (!cv::imwrite(path, image)) throw std::runtime_error("cannot write " + path);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc == 2 && std::strcmp(argv[1], "--help") == 0) {
    printUsage(stdout);
    return 0;
  }
  if (argc != 3 && argc != 4) {
    printUsage(stderr);
    return 2;
  }
  cortshift_flow_phantom::PlanarPhantomSettings settings;
  try {
    const auto seed = argc == 4 ? static_cast<std::uint32_t>(std::stoul(argv[3])) : 1U;
    settings = cortshift_flow_phantom::phantomCase(argv[1], seed);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "make_phantom: %s\n", error.what());
    return 2;
  }
  try {
    const auto phantom = cortshift_flow_phantom::makePlanarPhantom(settings);
    const std::string folder = std::string(argv[2]) + "/";
    save(folder + "first.png", phantom.first);
    save(folder + "second.png", phantom.second);
    save(folder + "craniotomy.png", phantom.craniotomy);
    save(folder + "core.png", phantom.core);
    save(folder + "patch.png", phantom.patch);
    save(folder + "blood.png", phantom.blood);
    cortshift_flow::writeFlo(folder + "truth.flo", phantom.truth);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "make_phantom: %s\n", error.what());
    return 1;
  }
  return 0;
}

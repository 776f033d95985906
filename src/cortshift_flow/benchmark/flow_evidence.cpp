// What the images say of the flow of a pair, for script/fit_trust flow: both models, always.
#include <cstdint>
#include <cstdio>
#include <exception>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <stdexcept>
#include <string>

#include "estimator.hpp"
#include "images/prepare.hpp"
#include "trust/evidence.hpp"

namespace {

using namespace cortshift_flow;

constexpr char kUsage[] =
    "usage: flow_evidence FIRST SECOND OUT | flow_evidence --names\n"
    "Writes, for every fit of the flow of two images, int32 fit, rows and columns of the nodes (every fourth pixel), "
    "then\n"
    "for each node float32 u and v [px] and its evidence (trust/evidence.hpp). --names prints the names of the "
    "evidence.\n"
    "Exit: 0 done, 1 failed, 2 bad usage.\n";

void write(std::ofstream& out, const Told& told) {
  const std::int32_t size[3] = {static_cast<std::int32_t>(told.kind), told.evidence.rows, told.evidence.cols};
  out.write(reinterpret_cast<const char*>(size), sizeof(size));
  for (int j = 0; j < told.evidence.rows; ++j)
    for (int i = 0; i < told.evidence.cols; ++i) {
      const float flow[2] = {told.flow.u.row(4 * j)[4 * i], told.flow.v.row(4 * j)[4 * i]};
      out.write(reinterpret_cast<const char*>(flow), sizeof(flow));
      out.write(reinterpret_cast<const char*>(told.evidence.ptr<float>(j) + static_cast<std::ptrdiff_t>(i) * kCues),
                kCues * sizeof(float));
    }
}

void run(char** argv) {
  const cv::Mat first = cv::imread(argv[1]), second = cv::imread(argv[2]);
  checkImages(first, second, {}, {});
  std::vector<Told> told;
  estimateFlow(prepareImages(first, second, {}, {}, 1), {}, 1, &told);
  std::ofstream out(argv[3], std::ios::binary);
  for (const Told& each : told) write(out, each);
  if (!out.flush()) throw std::runtime_error(std::string("cannot write ") + argv[3]);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc == 2 && std::string(argv[1]) == "--names") {
    for (const std::string& name : cueNames()) std::puts(name.c_str());
    return 0;
  }
  if (argc != 4) {
    std::fputs(kUsage, argc == 2 && std::string(argv[1]) == "--help" ? stdout : stderr);
    return argc == 2 && std::string(argv[1]) == "--help" ? 0 : 2;
  }
  try {
    run(argv);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "flow_evidence: %s\n", error.what());
    return 1;
  }
  return 0;
}

#include "cortshift_flow_phantom/phantom_cases.hpp"

#include <stdexcept>
#include <utility>

namespace cortshift_flow_phantom {
namespace {

using Settings = PlanarPhantomSettings;
using Case = std::pair<std::string, void (*)(Settings&)>;

const std::vector<Case>& cases() {
  static const std::vector<Case> all = {
      {"outward", [](Settings&) {}},
      {"inward", [](Settings& s) { s.motion = Motion::kInward; }},
      {"outward_tissue", [](Settings& s) { s.surround = Surround::kTissue; }},
      {"inward_tissue",
       [](Settings& s) {
         s.motion = Motion::kInward;
         s.surround = Surround::kTissue;
       }},
      {"outward_overlaid", [](Settings& s) { s.surround = Surround::kOverlaid; }},
      {"inward_overlaid",
       [](Settings& s) {
         s.motion = Motion::kInward;
         s.surround = Surround::kOverlaid;
       }},
      {"outward_all", [](Settings& s) { s.surround = Surround::kContinuing; }},
      {"inward_all",
       [](Settings& s) {
         s.motion = Motion::kInward;
         s.surround = Surround::kContinuing;
       }},
      {"noise2", [](Settings& s) { s.noise = 2; }},
      {"noise5", [](Settings& s) { s.noise = 5; }},
      {"gain",
       [](Settings& s) {
         s.gain = 0.92;
         s.offset = 0.08;
       }},
      {"vignette", [](Settings& s) { s.vignette = 0.3; }},
      {"motion80", [](Settings& s) { s.largest_motion = 80; }},
      {"blood", [](Settings& s) { s.blood = 0.05; }},
      {"smooth600",
       [](Settings& s) {
         s.size = {600, 600};
         s.motion = Motion::kSmooth;
         s.largest_motion = 20;
         s.featureless_patch = false;
       }},
      {"size512",
       [](Settings& s) {
         s.size = {512, 512};
       }},
      {"size1024",
       [](Settings& s) {
         s.size = {1024, 1024};
       }},
      {"size2048",
       [](Settings& s) {
         s.size = {2048, 2048};
       }},
  };
  return all;
}

}  // namespace

std::vector<std::string> phantomCaseNames() {
  std::vector<std::string> names;
  for (const Case& c : cases()) names.push_back(c.first);
  return names;
}

PlanarPhantomSettings phantomCase(const std::string& name, std::uint32_t seed) {
  for (const Case& c : cases())
    if (c.first == name) {
      PlanarPhantomSettings settings;
      settings.seed = seed;
      c.second(settings);
      return settings;
    }
  throw std::invalid_argument("'" + name + "' is not a phantom case");
}

}  // namespace cortshift_flow_phantom

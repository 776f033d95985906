#include "cortshift_tracking/igtl/request.hpp"

#include <algorithm>
#include <sstream>
#include <stdexcept>

#include "cortshift_tracking/case/stage_key.hpp"

namespace cortshift_tracking::igt {
namespace {

constexpr std::size_t kMaxText = 1024;
const char* const kCapture = "capture_stage";
const char* const kCompute = "compute_shift";

std::string takeKey(std::istringstream& in, const char* what) {
  std::string key;
  if (!(in >> key) || !isKey(key)) throw std::invalid_argument(std::string(what) + " must be " + kKeyRule);
  return key;
}

}  // namespace

Request parseRequest(const std::string& text) {
  if (text.size() > kMaxText || std::any_of(text.begin(), text.end(), [](unsigned char c) { return c < 0x20; }))
    throw std::invalid_argument("a request is one line of at most " + std::to_string(kMaxText) + " characters");
  std::istringstream in(text);
  std::string verb, rest;
  in >> verb;
  Request request;
  if (verb == kCapture) {
    request.kind = Request::Kind::kCaptureStage;
    request.key = takeKey(in, "the key of capture_stage KEY [NOTE]");
    std::getline(in >> std::ws, request.note);
  } else if (verb == kCompute) {
    request.kind = Request::Kind::kComputeShift;
    request.from_key = takeKey(in, "FROM of compute_shift FROM TO");
    request.to_key = takeKey(in, "TO of compute_shift FROM TO");
    if (in >> rest) throw std::invalid_argument("compute_shift takes FROM and TO and nothing else");
  } else {
    throw std::invalid_argument("not understood; understood are: capture_stage KEY [NOTE], compute_shift FROM TO");
  }
  return request;
}

std::string joinRequest(const std::string& name, const std::string& content) {
  if (name != kCapture && name != kCompute) return content;
  return content.compare(0, name.size(), name) == 0 ? content : name + " " + content;
}

}  // namespace cortshift_tracking::igt

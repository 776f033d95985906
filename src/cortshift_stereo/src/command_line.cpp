#include "cortshift_stereo/command_line.hpp"

#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>

namespace cortshift_stereo {
namespace {

double numberIn(const std::string& name, const std::string& text) {
  char* end = nullptr;
  const double value = std::strtod(text.c_str(), &end);
  if (text.empty() || *end != '\0') throw UsageError("--" + name + " " + text + ": not a number");
  return value;
}

}  // namespace

Options::Options(int argc, char** argv, const std::set<std::string>& known, const std::vector<std::string>& words,
                 const std::set<std::string>& lists) {
  auto next_word = words.begin();
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    if (word.rfind("--", 0) != 0) {
      if (next_word == words.end()) throw UsageError("'" + word + "': options begin with --");
      values_[*next_word++] = word;
      continue;
    }
    const std::string name = word.substr(2);
    if (lists.count(name)) {
      const int first = i + 1;
      while (i + 1 < argc && std::strncmp(argv[i + 1], "--", 2) != 0) lists_[name].push_back(argv[++i]);
      if (i + 1 == first) throw UsageError(word + ": its values are missing");
      continue;
    }
    if (!known.count(name)) throw UsageError(word + ": no such option");
    if (++i == argc) throw UsageError(word + ": its value is missing");
    if (!values_.emplace(name, argv[i]).second) throw UsageError(word + ": given twice");
  }
  if (next_word != words.end()) throw UsageError(*next_word + " is missing");
}

std::optional<std::string> Options::find(const std::string& name) const {
  const auto found = values_.find(name);
  if (found == values_.end()) return std::nullopt;
  return found->second;
}

std::string Options::required(const std::string& name) const {
  const auto value = find(name);
  if (!value) throw UsageError("--" + name + " is missing");
  return *value;
}

std::vector<std::string> Options::list(const std::string& name) const {
  const auto found = lists_.find(name);
  return found == lists_.end() ? std::vector<std::string>() : found->second;
}

double Options::requiredNumber(const std::string& name) const { return numberIn(name, required(name)); }

double Options::number(const std::string& name, double otherwise) const {
  const auto value = find(name);
  return value ? numberIn(name, *value) : otherwise;
}

int runTool(int argc, char** argv, const std::string& help, const std::set<std::string>& known,
            const std::function<void(const Options&)>& tool, const std::vector<std::string>& words,
            const std::set<std::string>& lists) {
  const char* name = std::strrchr(argv[0], '/');
  name = name ? name + 1 : argv[0];
  for (int i = 1; i < argc; ++i)
    if (std::strcmp(argv[i], "--help") == 0 || std::strcmp(argv[i], "-h") == 0) {
      std::fputs(help.c_str(), stdout);
      return 0;
    }
  try {
    tool(Options(argc, argv, known, words, lists));
    return 0;
  } catch (const UsageError& fault) {
    std::fprintf(stderr, "%s: %s; see --help\n", name, fault.what());
    return 2;
  } catch (const std::exception& fault) {
    std::fprintf(stderr, "%s: %s\n", name, fault.what());
    return 1;
  }
}

std::function<void(double)> progressBar(const std::string& label, double amount, const std::string& unit) {
  if (!isatty(STDERR_FILENO)) return {};
  const auto begin = std::chrono::steady_clock::now();
  return [=](double share) {
    constexpr int kWidth = 40;
    const int filled = static_cast<int>(share * kWidth);
    const double elapsed = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    std::string pace;
    char text[64];
    if (amount > 0 && elapsed > 0) {
      std::snprintf(text, sizeof text, "  %.2f %s/s", share * amount / elapsed, unit.c_str());
      pace += text;
    }
    if (share > 0 && share < 1) {
      std::snprintf(text, sizeof text, "  %.0f s left", elapsed * (1 - share) / share);
      pace += text;
    }
    std::fprintf(stderr, "\r%-22s [%s%s] %3d %%%s\033[K%s", label.c_str(), std::string(filled, '#').c_str(),
                 std::string(kWidth - filled, ' ').c_str(), static_cast<int>(share * 100), pace.c_str(),
                 share >= 1 ? "\n" : "");
    std::fflush(stderr);
  };
}

}  // namespace cortshift_stereo

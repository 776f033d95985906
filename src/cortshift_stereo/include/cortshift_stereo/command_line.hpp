// What the command line tools share: options, exit codes and a progress bar.
#pragma once

#include <functional>
#include <map>
#include <optional>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

namespace cortshift_stereo {

/// A command line that is wrong. The message names the option and the remedy.
class UsageError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Options of the form --name VALUE, and words without an option.
class Options {
 public:
  /// @param words  names under which words without an option are found, in this order; each must be given
  /// @param lists  options that take any number of values, --name VALUE VALUE ..., and may stand more than once
  /// @throws UsageError for an option that is not known, stands twice or lacks its value, for stray and missing words.
  Options(int argc, char** argv, const std::set<std::string>& known, const std::vector<std::string>& words = {},
          const std::set<std::string>& lists = {});

  /// @throws UsageError if the option is missing.
  std::string required(const std::string& name) const;
  std::optional<std::string> find(const std::string& name) const;

  /// Values of a list option in their order; empty where it is not given.
  std::vector<std::string> list(const std::string& name) const;

  /// @throws UsageError if the option is missing or not a number.
  double requiredNumber(const std::string& name) const;

  /// @throws UsageError if the option is there but not a number.
  double number(const std::string& name, double otherwise) const;

 private:
  std::map<std::string, std::string> values_;
  std::map<std::string, std::vector<std::string>> lists_;
};

/// Run a tool: --help prints the help and returns 0, a UsageError 2, any other exception 1, with its message on stderr.
int runTool(int argc, char** argv, const std::string& help, const std::set<std::string>& known,
            const std::function<void(const Options&)>& tool, const std::vector<std::string>& words = {},
            const std::set<std::string>& lists = {});

/// A progress bar on stderr if that is a terminal, with the time that remains. Call with a share (0...1).
/// @param amount, unit  what the whole is, for the rate; 0: no rate is shown
std::function<void(double)> progressBar(const std::string& label, double amount = 0, const std::string& unit = "");

}  // namespace cortshift_stereo

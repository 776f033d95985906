// An empty folder for a case, for each test.
#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <string>
#include <vector>

#include "cortshift_tracking/error.hpp"

namespace cortshift_tracking {

class CaseFolderTest : public testing::Test {
 protected:
  CaseFolderTest() {
    std::string name = (std::filesystem::temp_directory_path() / "cortshift-case-XXXXXX").string();
    folder = ::mkdtemp(name.data());
  }
  ~CaseFolderTest() override {
    std::error_code ignored;
    std::filesystem::remove_all(folder, ignored);
  }

  std::vector<std::filesystem::path> bags() const {
    std::vector<std::filesystem::path> found;
    for (const auto& file : std::filesystem::directory_iterator(folder))
      if (file.path().extension() == ".bag") found.push_back(file.path());
    std::sort(found.begin(), found.end());
    return found;
  }

  template <typename Action>
  static std::string refusal(Action action) {
    try {
      action();
    } catch (const TrackingError& error) {
      return error.what();
    }
    return "";
  }

  static testing::AssertionResult holds(const std::string& text, const std::string& part) {
    if (text.find(part) != std::string::npos) return testing::AssertionSuccess();
    return testing::AssertionFailure() << "'" << part << "' is not in: " << text;
  }

  std::filesystem::path folder;
};

}  // namespace cortshift_tracking

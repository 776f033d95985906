// Files that are there whole or not at all, and descriptors that are given back.
#include "cortshift_stereo/durable_file.hpp"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <unistd.h>

#include <fstream>
#include <functional>

#include "scratch_folder.hpp"

namespace cortshift_stereo {
namespace {

using testing::HasSubstr;

std::string refusal(const std::function<void()>& action) {
  try {
    action();
  } catch (const FileError& error) {
    return error.what();
  }
  return "not refused";
}

std::string contentOf(const std::string& path) {
  std::ifstream file(path);
  return {std::istreambuf_iterator<char>(file), {}};
}

TEST(DurableFile, IsWrittenOnceReplacedAndAppendedTo) {
  const ScratchFolder folder;
  const std::string path = folder.file("a");
  writeDurably(path, "first", 5);
  EXPECT_EQ(contentOf(path), "first");
  EXPECT_THAT(refusal([&] { writeDurably(path, "again", 5); }), HasSubstr("File exists"));
  EXPECT_EQ(contentOf(path), "first");
  replaceDurably(path, "second", 6);
  appendDurably(path, ", third", 7);
  EXPECT_EQ(readWhole(path), "second, third");
  moveDurably(path, folder.file("b"));
  EXPECT_FALSE(std::filesystem::exists(path));
  EXPECT_EQ(contentOf(folder.file("b")), "second, third");
  writeDurably(path, "new", 3);
  EXPECT_THAT(refusal([&] { moveDurably(path, folder.file("b")); }), HasSubstr("File exists"));
  EXPECT_EQ(contentOf(folder.file("b")), "second, third");
  for (const auto& entry : std::filesystem::directory_iterator(folder.path()))
    EXPECT_NE(entry.path().extension(), kPartialEnding) << entry.path();
}

TEST(DurableFile, RefusalsNameTheFileTheReasonAndTheRemedy) {
  const ScratchFolder folder;
  for (const std::string& said : {refusal([&] { writeDurably(folder.file("no/such"), "x", 1); }),
                                  refusal([&] { appendDurably(folder.file("no/such"), "x", 1); }),
                                  refusal([&] { readWhole(folder.file("no/such")); })}) {
    EXPECT_THAT(said, HasSubstr(folder.file("no")));
    EXPECT_THAT(said, HasSubstr("No such file or directory"));
  }
  EXPECT_THAT(refusal([&] { readWhole(folder.path()); }), HasSubstr(folder.path()));
}

// A node whose standard input is closed gets 0 as the number of its next file.
TEST(DurableFile, EveryDescriptorIsGivenBack) {
  const ScratchFolder folder;
  const int input = ::dup(STDIN_FILENO);
  ::close(STDIN_FILENO);
  writeDurably(folder.file("a"), "x", 1);
  replaceDurably(folder.file("a"), "y", 1);
  appendDurably(folder.file("a"), "z", 1);
  const std::string read = readWhole(folder.file("a"));
  const bool left_open = ::fcntl(STDIN_FILENO, F_GETFD) != -1;
  if (input >= 0) {
    ::dup2(input, STDIN_FILENO);
    ::close(input);
  }
  EXPECT_EQ(read, "yz");
  EXPECT_FALSE(left_open);
}

}  // namespace
}  // namespace cortshift_stereo

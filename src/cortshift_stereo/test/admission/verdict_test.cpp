// What evidence amounts to, the table of checks, and the hash of what a result was made with.
#include "cortshift_stereo/admission/verdict.hpp"

#include <gmock/gmock.h>

#include <fstream>
#include <set>
#include <sstream>

#include "cortshift_stereo/provenance.hpp"

namespace cortshift_stereo {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

TEST(Findings, NothingFoundIsAccepted) {
  const Findings none;
  EXPECT_EQ(none.verdict(), Verdict::kAccept);
  EXPECT_EQ(none.refusal(), nullptr);
  EXPECT_TRUE(none.warnings().empty());
  EXPECT_NO_THROW(none.requireAccepted());
}

TEST(Findings, TheWorstDecidesAndTheFirstRefusalIsTold) {
  Findings found;
  found.warn(CheckId::kPoseJitter, "The pose", "trembles by 0.3 mm", "check the tracker");
  EXPECT_EQ(found.verdict(), Verdict::kWarn);
  EXPECT_NO_THROW(found.requireAccepted());
  found.refuse(CheckId::kBlank, "The left image", "is blank", "check the light");
  found.refuse(CheckId::kDefocused, "The left image", "is out of focus", "focus the microscope");
  EXPECT_EQ(found.verdict(), Verdict::kRefuse);
  try {
    found.requireAccepted();
    FAIL() << "accepted";
  } catch (const PairError& error) {
    EXPECT_EQ(error.reason(), "blank");
    EXPECT_STREQ(error.what(), "The left image is blank: check the light.");
  }
}

TEST(Findings, AWarningIsSaidOnce) {
  Findings found;
  for (int i = 0; i < 2; ++i) found.warn(CheckId::kPoseJitter, "The pose", "trembles by 0.3 mm", "check the tracker");
  EXPECT_THAT(found.warnings(), ElementsAre("The pose trembles by 0.3 mm: check the tracker."));
}

TEST(Checks, EveryOneStandsInTheTableUnderAWordOfItsOwn) {
  std::set<std::string> words;
  for (int i = 0; i < static_cast<int>(CheckId::kCount); ++i) {
    const Check check = checkOf(static_cast<CheckId>(i));
    EXPECT_TRUE(words.insert(check.word).second) << check.word;
    EXPECT_FALSE(check.looks_at.empty() || check.limit.empty() || check.acts.empty()) << check.word;
  }
  EXPECT_THROW(checkOf(CheckId::kCount), std::logic_error);
}

TEST(Checks, TheDocumentationIsTheTable) {
  std::ifstream file(CORTSHIFT_DOC_DIR "/checks.md");
  std::stringstream text;
  text << file.rdbuf();
  EXPECT_EQ(text.str(), checksAsMarkdown()) << "write it anew: rosrun cortshift_stereo list_checks > doc/checks.md";
}

TEST(Provenance, Sha256AgreesWithTheStandardsExamples) {  // FIPS 180-4: one block, two blocks, a million bytes
  EXPECT_EQ(sha256("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  EXPECT_EQ(sha256("abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq"),
            "248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1");
  EXPECT_EQ(sha256(std::string(1000000, 'a')), "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0");
  EXPECT_EQ(sha256(""), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
}

TEST(Provenance, TheSoftwareIsNamed) { EXPECT_FALSE(softwareVersion().empty()); }

}  // namespace
}  // namespace cortshift_stereo

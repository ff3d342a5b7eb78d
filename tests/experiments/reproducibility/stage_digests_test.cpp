#include "experiments/reproducibility/stage_digests.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/error.h"
#include "core/file_io.h"
#include "tests/error_message.h"
#include "tests/temporary_folder.h"

namespace segsim::experiments {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;
using tests::TemporaryFolder;

reproducibility::DigestRecord record(const std::string& processor) {
  reproducibility::DigestRecord made{"flat", "5b56", "0.1.0 (abc)", {}, {processor}, {}};
  made.machine.kernels = core::KernelChoice::kReproducible;
  made.machine.processor = processor;
  made.machine.features = {{"avx2", "yes"}};
  made.machine.libraries = {{"libtorch", "1.13.1"}};
  made.machine.fingerprints = {{"matrix product (BLAS)", "aaaa"}, {"sums (libtorch)", "bbbb"}};
  made.stages = {{reproducibility::DigestStage::kCapture, "flat-3", "11"},
                 {reproducibility::DigestStage::kWeights, "after", "22"},
                 {reproducibility::DigestStage::kTrials, "", "33"}};
  return made;
}

TEST(StageDigests, ARecordIsReadAsItWasWritten) {
  const TemporaryFolder folder;
  reproducibility::write_digests(folder.path() / "d.json", record("EPYC"));
  const reproducibility::DigestRecord read =
      reproducibility::read_digests(folder.path() / "d.json");
  EXPECT_EQ(read.experiment, "flat");
  EXPECT_EQ(read.machine.kernels, core::KernelChoice::kReproducible);
  EXPECT_EQ(read.machine.fingerprints, record("EPYC").machine.fingerprints);
  EXPECT_EQ(read.machine.libraries, record("EPYC").machine.libraries);
  EXPECT_EQ(read.confirmed_on, std::vector<std::string>{"EPYC"});
  ASSERT_EQ(read.stages.size(), 3U);
  EXPECT_EQ(read.stages[1].stage, reproducibility::DigestStage::kWeights);
  EXPECT_EQ(read.stages[1].subject, "after");
  EXPECT_EQ(read.stages[1].sha256, "22");
}

TEST(StageDigests, TheFirstStageThatDepartsAndTheLibraryBehindItAreNamed) {
  reproducibility::DigestRecord found = record("Xeon");
  EXPECT_TRUE(reproducibility::compare_digests(record("EPYC"), found)
                  .equal);  // The processor alone is no fault.
  found.stages[1].sha256 = "99";
  found.stages[2].sha256 = "98";
  found.machine.fingerprints["matrix product (BLAS)"] = "cccc";
  const reproducibility::DigestComparison comparison =
      reproducibility::compare_digests(record("EPYC"), found);
  EXPECT_FALSE(comparison.equal);
  EXPECT_THAT(comparison.text, HasSubstr("capture flat-3: as recorded\n"));
  EXPECT_THAT(comparison.text,
              HasSubstr("weights after: recorded 22, here 99   <- the first that departs\n"));
  EXPECT_THAT(comparison.text, HasSubstr("trials: recorded 33, here 98\n"));
  EXPECT_THAT(comparison.text, HasSubstr("matrix product (BLAS): recorded aaaa, here cccc"));
  EXPECT_THAT(comparison.text, HasSubstr("processor is: recorded EPYC, here Xeon"));
  EXPECT_THAT(comparison.text, Not(HasSubstr("sums")));
}

TEST(StageDigests, ProcessorsAreToldApartByTheirVectors) {
  reproducibility::MachineRecord machine;
  machine.processor = "AMD EPYC";
  machine.features = {{"avx2", "yes"}, {"avx512f", "no"}};
  EXPECT_EQ(reproducibility::processor_in_words(machine), "AMD EPYC (AVX2)");
  machine.features["avx512f"] = "yes";
  EXPECT_EQ(reproducibility::processor_in_words(machine), "AMD EPYC (AVX-512)");
}

TEST(StageDigests, AMissingStageDeparts) {
  reproducibility::DigestRecord found = record("EPYC");
  found.stages.pop_back();
  const reproducibility::DigestComparison comparison =
      reproducibility::compare_digests(record("EPYC"), found);
  EXPECT_FALSE(comparison.equal);
  EXPECT_THAT(comparison.text, HasSubstr("trials: missing   <- the first that departs"));
}

TEST(StageDigests, ARecordCollectsProcessorsThatAgreeAndNoOthers) {
  const TemporaryFolder folder;
  const auto file = folder.path() / "flat.json";
  reproducibility::record_digests(file, record("EPYC"));
  reproducibility::record_digests(file, record("Xeon"));
  reproducibility::record_digests(file, record("Xeon"));
  EXPECT_EQ(reproducibility::read_digests(file).confirmed_on,
            (std::vector<std::string>{"EPYC", "Xeon"}));
  reproducibility::DigestRecord other = record("Atom");
  other.stages[0].sha256 = "12";
  EXPECT_THROW(reproducibility::record_digests(file, other), core::CheckFailed);
  EXPECT_EQ(reproducibility::read_digests(file).confirmed_on.size(), 2U);
}

TEST(StageDigests, WhatNamesProgramOrFolderDoesNotCount) {
  const TemporaryFolder folder;
  folder.write("a/scenes/room/scene.yaml", "created_by: 1");
  folder.write("a/scenes/room/surfels.ply", "ply");
  folder.write("a/episodes/room.jsonl", "header of program 1\n{1}\n{2}\n");
  folder.write("b/scenes/room/scene.yaml", "created_by: 2");
  folder.write("b/scenes/room/surfels.ply", "ply");
  folder.write("b/episodes/room.jsonl", "header of program 2\n{1}\n{2}\n");
  const auto digests = [&](const char* work) {
    return reproducibility::digest_stages(folder.path() / work,
                                          {folder.path() / work / "scenes/room"}, "33");
  };
  const auto first = digests("a");
  ASSERT_EQ(first.size(), 3U);  // Reconstruction, episodes, trials.
  for (std::size_t i = 0; i < 3; ++i) EXPECT_EQ(first[i].sha256, digests("b")[i].sha256) << i;
  folder.write("b/scenes/room/surfels.ply", "plz");
  folder.write("b/episodes/room.jsonl", "header of program 2\n{1}\n{3}\n");
  EXPECT_NE(first[0].sha256, digests("b")[0].sha256);
  EXPECT_NE(first[1].sha256, digests("b")[1].sha256);
  EXPECT_EQ(reproducibility::digest_stages(folder.path() / "a", {}, "").size(),
            1U);  // No trials yet.
  folder.write("a/phrases/room.json", "{}");
  folder.write("a/phrases/room.json.step", "recipe");
  const auto with_phrases = digests("a");
  ASSERT_EQ(with_phrases.size(), 4U);
  EXPECT_EQ(with_phrases[1].stage, reproducibility::DigestStage::kPhrases);
  EXPECT_EQ(with_phrases[1].subject, "phrases/room");
}

TEST(StageDigests, AnotherFileIsRefused) {
  const TemporaryFolder folder;
  folder.write("d.json", R"({"schema": "segsim.digests/9"})");
  EXPECT_THROW((void)reproducibility::read_digests(folder.path() / "d.json"),
               core::InputError);
}

TEST(StageDigests, AnUnknownStageIsRefusedWithItsFile) {
  const TemporaryFolder folder;
  const auto file = folder.path() / "d.json";
  reproducibility::write_digests(file, record("EPYC"));
  std::string text = core::read_file(file);
  text.replace(text.find("weights"), 7, "weihgts");
  folder.write("d.json", text);
  EXPECT_EQ(tests::input_error_of([&] { (void)reproducibility::read_digests(file); }),
            file.string() +
                ": stages: expected a stage (capture, reconstruction, phrases, "
                "episodes, labels, weights, trials), found \"weihgts\"");
}

TEST(DigestStage, NamesInRecordsStay) {
  const std::pair<reproducibility::DigestStage, const char*> names[] = {
      {reproducibility::DigestStage::kCapture, "capture"},
      {reproducibility::DigestStage::kReconstruction, "reconstruction"},
      {reproducibility::DigestStage::kPhrases, "phrases"},
      {reproducibility::DigestStage::kEpisodes, "episodes"},
      {reproducibility::DigestStage::kLabels, "labels"},
      {reproducibility::DigestStage::kWeights, "weights"},
      {reproducibility::DigestStage::kTrials, "trials"}};
  for (const auto& [stage, name] : names) {
    EXPECT_STREQ(reproducibility::to_string(stage), name);
    EXPECT_EQ(reproducibility::digest_stage_from(name, "here"), stage);
  }
}

TEST(MachineRecord, FingerprintsAreOfTheMachineAndNotOfChance) {
  const reproducibility::MachineRecord first = reproducibility::describe_machine(),
                                       again = reproducibility::describe_machine();
  EXPECT_EQ(first.fingerprints, again.fingerprints);
  EXPECT_GE(first.fingerprints.size(), 8U);
  for (const auto& [name, sha256] : first.fingerprints) EXPECT_EQ(sha256.size(), 64U) << name;
}

}  // namespace
}  // namespace segsim::experiments

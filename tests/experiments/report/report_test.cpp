#include "experiments/report/report.h"

#include <fstream>
#include <regex>
#include <set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/error.h"
#include "core/file_io.h"
#include "experiments/reproducibility/stage_digests.h"
#include "experiments/runs/run.h"
#include "perception/data/image_file.h"
#include "tests/experiments/browser.h"
#include "tests/experiments/tiny_scene.h"
#include "tests/experiments/tiny_spec.h"

namespace segsim::experiments {
namespace {

namespace fs = std::filesystem;
using testing::Contains;
using testing::HasSubstr;
using testing::Not;
using tests::browse;
using tests::Browsed;

constexpr const char* kHostile = R"(<b>"x" & 'y'</b>)";

records::TrialRow a_trial(std::int64_t id, const std::string& arm, int episode, bool success) {
  records::TrialRow t;
  t.trial_id = id;
  t.arm = arm;
  t.scene = "s & <1>";
  t.goal_class = kHostile;
  t.episode = "s & <1>/" + std::string(kHostile) + "/" + std::to_string(episode);
  t.success = success;
  t.outcome = success ? records::TrialOutcome::kSuccess : records::TrialOutcome::kTimeout;
  t.why.cause = success ? records::Cause::kDidNotFail : records::Cause::kFalseNegative;
  t.ticks = 20 + episode;
  t.sim_s = 5;
  t.render_ms = 10 + episode;
  return t;
}

/// Ten episodes whose every name holds what HTML gives a meaning to; no logs, no bundle.
results::StoredRun a_hostile_run() {
  results::StoredRun stored;
  stored.run.run_id = 1;
  stored.run.name = "demo";
  stored.run.title = std::string("Demo ") + kHostile;
  stored.run.spec_text = "title: </pre><script>alert(1)</script>\n";
  stored.run.planned_trials = 20;
  stored.scenes = {{"s & <1>", kHostile, "aa", "bb", 10}};
  stored.arms = {{"before", "a.bin", "c", "", -1, {}}, {"after", "b.bin", "d", "", -1, {}}};
  for (int k = 0; k < 10; ++k) {
    stored.trials.push_back(a_trial(2 * k + 1, "before", k, k < 2));
    stored.trials.push_back(a_trial(2 * k + 2, "after", k, k < 9));
  }
  return stored;
}

report::ReportOptions into(const fs::path& folder) {
  report::ReportOptions options;
  options.output = folder;
  return options;
}

std::vector<fs::path> pages_of(const fs::path& report) {
  std::vector<fs::path> pages;
  for (const auto& entry : fs::recursive_directory_iterator(report)) {
    if (entry.path().extension() == ".html") pages.push_back(entry.path());
  }
  return pages;
}

std::string unescaped(std::string text) {
  for (const auto& [from, to] :
       {std::pair{"&quot;", "\""}, std::pair{"&#39;", "'"}, std::pair{"&lt;", "<"},
        std::pair{"&gt;", ">"}, std::pair{"&amp;", "&"}}) {
    const std::string word = from;
    for (std::size_t at = text.find(word); at != std::string::npos;
         at = text.find(word, at + 1)) {
      text.replace(at, word.size(), to);
    }
  }
  return text;
}

/// Every file that a page names is there, every anchor on a page of trials too.
void expect_links_resolve(const fs::path& report) {
  const std::regex link(R"((?:href|src)="([^"]*)\")");
  std::set<std::string> missing;
  for (const fs::path& page : pages_of(report)) {
    const std::string html = core::read_file(page);
    for (std::sregex_iterator at(html.begin(), html.end(), link), end; at != end; ++at) {
      const std::string target = unescaped((*at)[1]);
      EXPECT_EQ(target.find("://"), std::string::npos) << target;
      if (target == "data:,") continue;
      const std::string file = target.substr(0, target.find('#'));
      const fs::path path = file.empty() ? page : page.parent_path() / file;
      if (!fs::exists(path)) missing.insert(target);
      if (target.find("episodes/") == std::string::npos || file == target) continue;
      const std::string anchor = "id=\"" + target.substr(target.find('#') + 1) + "\"";
      EXPECT_THAT(core::read_file(path), HasSubstr(anchor));
    }
  }
  EXPECT_THAT(missing, testing::IsEmpty());
}

TEST(Report, NamesCannotBecomeMarkup) {
  const TemporaryFolder folder("report");
  const report::ReportSummary summary =
      report::write_report(a_hostile_run(), into(folder.path() / "r"));
  EXPECT_EQ(summary.pages, 12);
  for (const fs::path& page : pages_of(folder.path() / "r")) {
    const std::string html = core::read_file(page);
    EXPECT_THAT(html, Not(HasSubstr("<b>"))) << page;
    EXPECT_THAT(html, Not(HasSubstr("alert(1)</script>"))) << page;
    EXPECT_THAT(html, Not(HasSubstr("http"))) << page;
  }
  expect_links_resolve(folder.path() / "r");
}

TEST(Report, TheFirstPageHasTheAnswer) {
  const TemporaryFolder folder("report");
  results::StoredRun stored = a_hostile_run();
  stored.arms[1].exposure =
      records::SceneExposure{.known = records::TrainingDataKnown::kNothing};
  (void)report::write_report(stored, into(folder.path() / "r"));
  const std::string index = core::read_file(folder.path() / "r" / "index.html");
  EXPECT_THAT(index, HasSubstr("Yes, it got better."));
  EXPECT_THAT(index, HasSubstr("20 % &rarr; 90 %"));
  EXPECT_THAT(index, HasSubstr("p = 0.016"));  // Exact McNemar test of 7 against 0.
  // Numbers lead to the trials behind them.
  EXPECT_THAT(index, HasSubstr("trials.html#arm=after&amp;counts=1&amp;fate=false_negative"));
  EXPECT_THAT(index, HasSubstr("change=gained\">7 gained</a>"));
  EXPECT_THAT(index, HasSubstr("1 of 10 failed"));
  EXPECT_THAT(index, HasSubstr("<li>LEAKAGE unknown: &quot;after&quot; (b.bin): the file does "
                               "not say what it was trained on.</li>"));
  EXPECT_THAT(index, HasSubstr("after: b.bin, weights d, leakage: unknown"));
  EXPECT_THAT(core::read_file(folder.path() / "r" / "trials.html"),
              HasSubstr("data-change=\"gained\""));
}

TEST(Report, ShowsTheDigestsOfItsOwnSpecAlone) {
  const TemporaryFolder folder("report");
  results::StoredRun stored = a_hostile_run();
  stored.folder = folder.path();
  stored.run.spec_sha256 = "5bec";
  reproducibility::DigestRecord record;
  record.experiment = "demo";
  record.spec_sha256 = "5bec";
  record.machine.kernels = core::KernelChoice::kReproducible;
  record.machine.processor = "Abacus & Sons";
  record.stages = {{reproducibility::DigestStage::kCapture, "s & <1>", std::string(64, 'a')},
                   {reproducibility::DigestStage::kTrials, "", std::string(64, 'b')}};
  const auto index_with = [&](const reproducibility::DigestRecord& beside) {
    reproducibility::write_digests(folder.path() / "digests.json", beside);
    (void)report::write_report(stored, into(folder.path() / "r"));
    return core::read_file(folder.path() / "r" / "index.html");
  };
  const std::string index = index_with(record);
  EXPECT_THAT(index, HasSubstr("<tr><td>capture</td><td>s &amp; &lt;1&gt;</td><td><code>" +
                               std::string(64, 'a') + "</code></td></tr>"));
  EXPECT_THAT(index, HasSubstr("<tr><td>trials</td><td></td><td><code>" +
                               std::string(64, 'b') + "</code></td></tr>"));
  EXPECT_THAT(index, HasSubstr("Computed on Abacus &amp; Sons"));
  EXPECT_THAT(index, HasSubstr("with reproducible kernels"));
  record.spec_sha256 = "07e4";  // The folder was used for another spec since.
  EXPECT_THAT(index_with(record), Not(HasSubstr("id=\"digests\"")));
}

/// The same run with a second training of "after" that does worse: 9 and 5 of 10.
results::StoredRun two_trainings() {
  results::StoredRun stored = a_hostile_run();
  stored.run.success_profile = "segsim-object: STOP within 1 m";
  stored.arms[1].finetune_seed = 2;
  stored.arms.push_back({"after.s3", "b3.bin", "e", "", -1, {}});
  stored.arms[2].family = "after";
  stored.arms[2].finetune_seed = 3;
  for (int k = 0; k < 10; ++k) {
    stored.trials.push_back(a_trial(100 + k, "after.s3", k, k >= 1 && k < 6));
  }
  return stored;
}

TEST(Report, TheFirstPageTellsOfTrainings) {
  const TemporaryFolder folder("report");
  (void)report::write_report(a_hostile_run(), into(folder.path() / "one"));
  const std::string one = core::read_file(folder.path() / "one" / "index.html");
  EXPECT_THAT(one, HasSubstr("<strong>one training</strong>"));
  EXPECT_THAT(one, HasSubstr("<li>ONE TRAINING: "));
  EXPECT_THAT(one, Not(HasSubstr("\"dots\"")));
  EXPECT_THAT(core::read_file(folder.path() / "one" / "trials.html"),
              Not(HasSubstr("name=\"training\"")));

  (void)report::write_report(two_trainings(), into(folder.path() / "two"));
  const std::string two = core::read_file(folder.path() / "two" / "index.html");
  EXPECT_THAT(two, HasSubstr("20 % &rarr; 70 %"));
  EXPECT_THAT(two, HasSubstr("14/20</a> episodes x trainings"));
  EXPECT_THAT(two, HasSubstr("test over 2 trainings"));
  EXPECT_THAT(two, HasSubstr("standard deviation between trainings: 28 points"));
  EXPECT_THAT(two, HasSubstr("Success rule: segsim-object."));
  EXPECT_THAT(two, HasSubstr("\"dots\":[0.9,0.5]"));
  EXPECT_THAT(two, HasSubstr("trials.html#training=after.s3&amp;counts=1"));
  EXPECT_THAT(two, Not(HasSubstr("one training")));
  // 7 gained by the first; by the second 4, and 1 lost.
  EXPECT_THAT(two, HasSubstr("change=gained\">11 gained</a>"));
  EXPECT_THAT(two, HasSubstr("change=lost\">1 lost</a>"));
  const std::string trials = core::read_file(folder.path() / "two" / "trials.html");
  EXPECT_THAT(trials, HasSubstr("name=\"training\""));
  EXPECT_THAT(trials, HasSubstr("data-arm=\"after\" data-training=\"after.s3\""));
  const auto count = [&](const std::string& part) {
    int found = 0;
    for (std::size_t at = trials.find(part); at != std::string::npos;
         at = trials.find(part, at + 1)) {
      ++found;
    }
    return found;
  };
  EXPECT_EQ(count("data-change=\"gained\""), 11);  // As many as the page says.
  EXPECT_EQ(count("data-change=\"lost\""), 1);
  expect_links_resolve(folder.path() / "two");
}

TEST(Report, ArmsAreChosenAndAnEarlierReportIsReplaced) {
  const TemporaryFolder folder("report");
  report::ReportOptions options = into(folder.path() / "r");
  options.before = "after";
  options.after = "before";
  (void)report::write_report(a_hostile_run(), options);
  EXPECT_THAT(core::read_file(options.output / "index.html"), HasSubstr("No, it got worse."));
  results::StoredRun shorter = a_hostile_run();
  shorter.trials.resize(4);
  EXPECT_EQ(report::write_report(shorter, options).pages, 4);
  EXPECT_EQ(pages_of(options.output).size(), 4U);

  options.before = "befor";
  EXPECT_THROW((void)report::write_report(shorter, options), core::InputError);
  std::ofstream(folder.path() / "mine.txt") << "x";
  options = into(folder.path());
  EXPECT_THROW((void)report::write_report(shorter, options), core::InputError);
  EXPECT_TRUE(fs::exists(folder.path() / "mine.txt"));
}

TEST(Report, RunsWithoutTrialsOrASecondArmHaveOneToo) {
  const TemporaryFolder folder("report");
  results::StoredRun stored = a_hostile_run();
  stored.arms.pop_back();
  std::erase_if(stored.trials, [](const records::TrialRow& t) { return t.arm == "after"; });
  (void)report::write_report(stored, into(folder.path() / "one"));
  EXPECT_THAT(core::read_file(folder.path() / "one" / "index.html"),
              HasSubstr("Success rates of 1 arm; no two are compared."));
  expect_links_resolve(folder.path() / "one");
  stored.trials.clear();
  EXPECT_EQ(report::write_report(stored, into(folder.path() / "none")).pages, 2);
  expect_links_resolve(folder.path() / "none");
}

TEST(Report, DelaySweepsBecomeAPlot) {
  const TemporaryFolder folder("report");
  results::StoredRun stored = a_hostile_run();
  stored.arms = {{"a+0ms", "w", "c", "", -1, {}}, {"a+200ms", "w", "c", "", -1, {}}};
  for (records::TrialRow& t : stored.trials) t.arm = t.arm == "after" ? "a+0ms" : "a+200ms";
  (void)report::write_report(stored, into(folder.path() / "r"));
  const std::string index = core::read_file(folder.path() / "r" / "index.html");
  EXPECT_THAT(index, HasSubstr("Success rate against added delay: a"));
  EXPECT_THAT(index, HasSubstr("<td>200</td><td>2/10</td><td>20.0 %</td>"));
}

/// A real run of two trials with its bundle, logs and pictures.
class ReportOfARun : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TemporaryFolder("report_run");
    TinyScene().write(folder_->path() / "tiny");
    runs::RunOptions options;
    options.folders = {folder_->path(), folder_->path() / "work"};
    options.workers = 1;
    (void)runs::run_experiment(specs::parse_spec(TinySpec{.more = "title: Two rooms\n"}.text(),
                                                 "tiny.yaml", options.folders),
                               options);
    report_ = folder_->path() / "report";
    summary_ =
        report::write_report(results::load_run(folder_->path() / "work"), into(report_));
  }
  static void TearDownTestSuite() { delete folder_; }

  static TemporaryFolder* folder_;
  static fs::path report_;
  static report::ReportSummary summary_;
};
TemporaryFolder* ReportOfARun::folder_ = nullptr;
fs::path ReportOfARun::report_;
report::ReportSummary ReportOfARun::summary_;

TEST_F(ReportOfARun, HasMapsFilmstripsAndStories) {
  EXPECT_EQ(summary_.pictures, 1 + 2 * 2);  // A map; a picture and a filmstrip for each trial.
  expect_links_resolve(report_);
  std::string episode;
  for (const auto& entry : fs::directory_iterator(report_ / "episodes")) {
    episode = core::read_file(entry.path());
  }
  EXPECT_THAT(episode, HasSubstr("find a couch in Two rooms"));
  EXPECT_THAT(episode, HasSubstr("src=\"../strips/trial-1.jpg\""));
  EXPECT_THAT(episode, HasSubstr("src=\"../pictures/trial-2.jpg\""));
  const auto strip = perception::read_image(report_ / "strips" / "trial-1.jpg");
  EXPECT_GE(strip.width_px(), 2 * 240);
  EXPECT_EQ(strip.height_px(), 40 + 3 * 180 + 2 * 4);
  EXPECT_THAT(core::read_file(report_ / "index.html"),
              HasSubstr("<polyline class=\"path\" stroke=\"#"));
}

TEST_F(ReportOfARun, TheNumberOfThreadsChangesNothing) {
  report::ReportOptions options = into(folder_->path() / "again");
  options.threads = 3;
  EXPECT_EQ(report::write_report(results::load_run(folder_->path() / "work"), options).bytes,
            summary_.bytes);
  for (const auto& entry : fs::recursive_directory_iterator(report_)) {
    if (!entry.is_regular_file()) continue;
    const fs::path name = fs::relative(entry.path(), report_);
    EXPECT_EQ(core::read_file(entry.path()), core::read_file(options.output / name)) << name;
  }
}

TEST_F(ReportOfARun, AMissingBundleIsSaidAndNoFailure) {
  results::StoredRun stored = results::load_run(folder_->path() / "work");
  fs::rename(folder_->path() / "tiny", folder_->path() / "away");
  const report::ReportSummary summary =
      report::write_report(stored, into(folder_->path() / "without"));
  fs::rename(folder_->path() / "away", folder_->path() / "tiny");
  EXPECT_THAT(summary.notes, Contains(HasSubstr("No map and filmstrips of Two rooms")));
  EXPECT_EQ(summary.pictures, 2);
  expect_links_resolve(folder_->path() / "without");
}

int count_of(const std::string& text, const std::string& word) {
  int count = 0;
  for (std::size_t at = text.find(word); at != std::string::npos;
       at = text.find(word, at + 1)) {
    ++count;
  }
  return count;
}

TEST_F(ReportOfARun, OpensInABrowserWithoutAnError) {
  if (!tests::has_browser()) {
    GTEST_SKIP() << "no chromium on this machine (Debian: apt-get install chromium)";
  }
  for (const fs::path& page : pages_of(report_)) {
    const Browsed browsed = browse("file://" + page.string(), folder_->path());
    EXPECT_THAT(browsed.dom, HasSubstr("data-ready=\"1\"")) << page << browsed.log;
    EXPECT_THAT(browsed.log, Not(HasSubstr(":CONSOLE"))) << page;
    EXPECT_EQ(count_of(browsed.dom, "<canvas"), count_of(browsed.dom, "data-drawn=\"1\""))
        << page;
  }
  const Browsed all = browse("file://" + (report_ / "trials.html").string(), folder_->path());
  EXPECT_THAT(all.dom, HasSubstr("2 of 2 trials"));
  const Browsed one =
      browse("file://" + (report_ / "trials.html").string() + "#arm=after", folder_->path());
  EXPECT_THAT(one.dom, HasSubstr("1 of 2 trials"));
  const Browsed none = browse(
      "file://" + (report_ / "trials.html").string() + "#arm=%3Cb%3E&x=1", folder_->path());
  EXPECT_THAT(none.dom, HasSubstr("0 of 2 trials"));
}

}  // namespace
}  // namespace segsim::experiments

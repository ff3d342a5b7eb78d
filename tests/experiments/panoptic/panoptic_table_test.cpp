#include "experiments/panoptic/panoptic_table.h"

#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <sstream>

#include <gmock/gmock.h>
#include <nlohmann/json.hpp>

#include "core/error.h"

namespace segsim::experiments {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;

/// The table's body as the paper's source has it: ScanNet, then ScanNet++.
constexpr const char* kLatex = R"(
Panoptic Lifting
    & 57.86 & 61.96 & 85.31 & 67.91 & 78.59 & 45.88 & 59.93
    & 71.14 & 77.48 & 88.14 & 81.34 & 89.67 & 56.17 & 68.51 \\
Contrastive Lift
    & 37.35 & 41.91 & 57.60 & 64.77 & 75.80 & 13.21 & 23.26
    & 47.58 & 57.23 & 65.81 & 81.09 & 89.30 & 27.39 & 36.51 \\
PVLFF
    & 30.11 & 51.71 & 44.43 & 55.41 & 63.96 & 45.75 & 48.41
    & 52.24 & 66.86 & 65.56 & 62.53 & 70.31 & 67.95 & 75.47 \\
Gaussian Grouping
    & 43.75 & 50.63 & 72.68 & 58.05 & 68.68 & 52.70 & 58.10
    & 33.10 & 40.60 & 67.27 & 59.53 & 68.13 & 29.83 & 36.83 \\
OpenGaussian
    & 48.73 & 51.48 & 88.10 & 54.05 & 68.43 & 44.43 & 49.60
    & 51.03 & 56.93 & 85.73 & 61.80 & 73.97 & 50.00 & 51.02  \\
PanopticRecon
    & 63.70 & 64.81 & 81.17 & 68.62 & 80.87 & 66.58 & 77.84
    & 68.29 & 77.01 & 85.05 & 77.75 & 87.08 & 51.34 & 62.79 \\
Ours
    & 74.12 & 74.12 & 100.0 & 74.93 & 83.07 & 72.89 & 79.14
    & 77.09 & 82.36 & 93.60 & 81.77 & 89.01 & 74.23 & 77.91 \\
)";

TEST(PanopticTable, ThePapersRowsAreThoseOfItsSource) {
  std::istringstream words(kLatex);
  std::vector<double> numbers;
  for (std::string word; words >> word;) {
    if (word.find_first_not_of("0123456789.") == std::string::npos) {
      numbers.push_back(std::stod(word));
    }
  }
  std::vector<double> ours;
  for (const panoptic::PaperRow& row : panoptic::paper_table1()) {
    for (const double value : {row.pq, row.sq, row.rq, row.mean_iou, row.mean_accuracy,
                               row.coverage, row.weighted_coverage}) {
      ours.push_back(value);
    }
  }
  EXPECT_EQ(ours, numbers);
  ASSERT_EQ(panoptic::paper_table1().size(), 14U);
  EXPECT_STREQ(panoptic::paper_table1()[12].data, "ScanNet");
  EXPECT_STREQ(panoptic::paper_table1()[12].head, "query");
  EXPECT_STREQ(panoptic::paper_table1()[13].data, "ScanNet++");
}

panoptic::SceneFigures figures(const std::string& scene, const std::string& data,
                               const std::string& head, double pq) {
  panoptic::SceneFigures f;
  f.scene = scene;
  f.title = "Scene " + scene;
  f.data = data;
  f.head = head;
  f.masks = "exact labels";
  f.recipe = "made up";
  f.version = "1.2.3";
  for (const std::string& rules : panoptic::panoptic_rule_names()) {
    panoptic::RuleFigures r;
    r.rules = rules;
    r.views = 7;
    r.pq = pq, r.sq = 0.5, r.rq = 0.25, r.pq_things = 0.1, r.pq_stuff = 0.2;
    r.pooled_iou = 0.625, r.pooled_accuracy = 0.75;
    r.per_frame_iou = 0.3125, r.per_frame_accuracy = 0.375;
    r.coverage = 0.125, r.weighted_coverage = 0.875;
    f.rules.push_back(r);
  }
  f.statistics = {{"held_out_psnr_db", 24.5}, {"geometry_seconds", 12.0}};
  f.mask_quality = {{"pq", 0.53}};
  return f;
}

panoptic::PanopticTable table() {
  panoptic::PanopticTable t;
  t.results = {figures("a", "procedural", "query", 0.5),
               figures("b", "procedural", "query", 0.75),
               figures("c", "Gazebo", "query", 0.25)};
  t.rules = {"strict", "zju"};
  t.missing = {{"Break room", "needs --data DIR"}};
  t.planned = 4;
  return t;
}

TEST(PanopticTable, JsonHasRowsMeansAndThePaper) {
  const auto json = nlohmann::json::parse(
      panoptic::format_panoptic_table(table(), support::TableFormat::kJson));
  EXPECT_EQ(json["schema"], "segsim.table1/1");
  EXPECT_EQ(json["unit"], "percent");
  EXPECT_EQ(json["planned"], 4);
  EXPECT_EQ(json["finished"], 3);
  ASSERT_EQ(json["tables"].size(), 2U);
  const auto& strict = json["tables"][0];
  EXPECT_EQ(strict["rules"], "strict");
  // Three scenes, the mean of the two procedural ones, the paper on two data sets.
  ASSERT_EQ(strict["rows"].size(), 6U);
  EXPECT_EQ(strict["rows"][0]["kind"], "scene");
  EXPECT_DOUBLE_EQ(strict["rows"][0]["pq"].get<double>(), 50.0);
  EXPECT_DOUBLE_EQ(strict["rows"][0]["mean_iou"].get<double>(), 62.5);
  EXPECT_EQ(strict["rows"][3]["kind"], "mean");
  EXPECT_EQ(strict["rows"][3]["scene"], "mean of 2");
  EXPECT_DOUBLE_EQ(strict["rows"][3]["pq"].get<double>(), 62.5);
  EXPECT_EQ(strict["rows"][4]["kind"], "paper");
  EXPECT_DOUBLE_EQ(strict["rows"][4]["pq"].get<double>(), 74.12);
  EXPECT_DOUBLE_EQ(strict["rows"][5]["weighted_coverage"].get<double>(), 77.91);
  // Under the rules that the paper presumably used: all of its rows, mIoU per frame.
  const auto& zju = json["tables"][1];
  EXPECT_EQ(zju["rows"].size(), 4U + 14U);
  EXPECT_DOUBLE_EQ(zju["rows"][0]["mean_iou"].get<double>(), 31.25);
  // Times are not of the result: a resumed run has others.
  EXPECT_FALSE(json["results"][0]["statistics"].contains("geometry_seconds"));
  EXPECT_DOUBLE_EQ(json["results"][0]["statistics"]["held_out_psnr_db"].get<double>(), 24.5);
  EXPECT_EQ(json["missing"][0]["scene"], "Break room");
}

TEST(PanopticTable, TextMarkdownAndCsvSayTheSame) {
  const std::string text =
      panoptic::format_panoptic_table(table(), support::TableFormat::kText);
  EXPECT_THAT(text, AllOf(HasSubstr("Scene a"), HasSubstr("62.50"), HasSubstr("74.12"),
                          HasSubstr("INTERIM: 3 of 4"), HasSubstr("needs --data DIR"),
                          HasSubstr("24.50")));
  EXPECT_THAT(panoptic::format_panoptic_table(table(), support::TableFormat::kMarkdown),
              HasSubstr("| query | procedural | mean of 2 | 62.50 | 50.00 | 25.00 |"));
  const std::string csv = panoptic::format_panoptic_table(table(), support::TableFormat::kCsv);
  EXPECT_THAT(csv, HasSubstr("strict,scene,query,procedural,Scene a,50,50,25,62.5,75,12.5,"
                             "87.5\n"));
  EXPECT_THAT(csv, HasSubstr("zju,paper,paper: PVLFF,ScanNet,,30.11,"));
  panoptic::PanopticTable comma = table();
  comma.results[0].title = "a, \"b\"";
  EXPECT_THAT(panoptic::format_panoptic_table(comma, support::TableFormat::kCsv),
              HasSubstr("procedural,\"a, \"\"b\"\"\",50"));
}

TEST(PanopticTable, TheRecordHasOurRowsAndNotThePapers) {
  const core::MeasurementRecord record = panoptic::panoptic_record(table(), true);
  EXPECT_TRUE(record.on_gpu);
  EXPECT_THAT(record.title, Not(HasSubstr("quick")));
  // Three scenes and the mean of two, seven columns, two sets of rules.
  EXPECT_EQ(record.values.size(), 4U * 7U * 2U);
  std::map<std::string, double> values;
  for (const core::MeasuredValue& value : record.values) {
    values[value.case_name + "; " + value.name] = value.value;
  }
  EXPECT_EQ(values.size(), record.values.size()) << "a name comes twice";
  EXPECT_DOUBLE_EQ(values.at("query, Scene a, strict; PQ"), 50.0);
  EXPECT_DOUBLE_EQ(values.at("query, procedural: mean of 2, strict; PQ"), 62.5);
  EXPECT_DOUBLE_EQ(values.at("query, Scene c, strict; mIoU"), 62.5);
  EXPECT_DOUBLE_EQ(values.at("query, Scene c, zju; mIoU"), 31.25);
  panoptic::PanopticTable quick = table();
  quick.quick = true;
  EXPECT_THAT(panoptic::panoptic_record(quick, false).title, HasSubstr("quick"));
}

TEST(PanopticTable, AFinishedTableIsNotInterim) {
  panoptic::PanopticTable t = table();
  t.planned = 3;
  EXPECT_THAT(panoptic::format_panoptic_table(t, support::TableFormat::kText),
              AllOf(Not(HasSubstr("INTERIM")), Not(HasSubstr("QUICK"))));
  t.quick = true;
  EXPECT_THAT(panoptic::format_panoptic_table(t, support::TableFormat::kText),
              HasSubstr("QUICK"));
}

std::string error_of(const std::function<void()>& call) {
  try {
    call();
  } catch (const core::InputError& error) {
    return error.what();
  }
  return "no error";
}

TEST(PanopticTable, UnknownWordsAreNamed) {
  EXPECT_THAT(panoptic::parse_rules("all"),
              ElementsAre("strict", "trajectory", "zju", "lifting", "coco"));
  EXPECT_THAT(panoptic::parse_rules("zju,strict"), ElementsAre("zju", "strict"));
  EXPECT_THAT(error_of([] { (void)panoptic::parse_rules("stict"); }),
              AllOf(HasSubstr("--rules: expected strict | "), HasSubstr("near: strict")));
  EXPECT_THAT(error_of([] { (void)panoptic::parse_rules(""); }),
              HasSubstr("--rules: expected"));
  EXPECT_THAT(panoptic::parse_heads("panoptic-lifting,query"),
              ElementsAre("panoptic-lifting", "query"));
  EXPECT_THAT(panoptic::parse_heads("query,query:joint,panoptic-recon++:joint"),
              ElementsAre("query", "query:joint", "panoptic-recon++:joint"));
  EXPECT_THAT(error_of([] { (void)panoptic::parse_heads("pvlff:joint"); }),
              HasSubstr("--heads: expected"));
  EXPECT_THAT(error_of([] { (void)panoptic::parse_heads("query,query"); }),
              HasSubstr("each once"));
  EXPECT_THAT(error_of([] { (void)panoptic::parse_heads("nerf"); }),
              AllOf(HasSubstr("--heads: expected query | "), HasSubstr("found \"nerf\"")));
  for (const char* scene : {"flat", "flat-", "flat-x", "flat-3x", "kitchen"}) {
    EXPECT_THAT(error_of([&] { (void)panoptic::panoptic_scenes(scene, ""); }),
                AllOf(HasSubstr("--scenes: expected flat-N"), HasSubstr(scene)));
  }
  EXPECT_THAT(error_of([] { (void)panoptic::panoptic_scenes("flat-3,flat-3", ""); }),
              HasSubstr("flat-3 again"));
  EXPECT_THAT(error_of([] { (void)panoptic::panoptic_scenes("house", ""); }),
              HasSubstr("--data DIR"));
}

class SceneFiles : public ::testing::Test {
 protected:
  SceneFiles()
      : folder_(fs::temp_directory_path() /
                ("segsim_panoptic_table_" + std::to_string(::getpid()))) {
    fs::remove_all(folder_);
    fs::create_directories(folder_ / "scans" / "one" / "pose");
    fs::create_directories(folder_ / "scans" / "one" / "color");
  }
  ~SceneFiles() override { fs::remove_all(folder_); }
  fs::path write(const std::string& text) const {
    std::ofstream(folder_ / "scenes.yaml") << text;
    return folder_ / "scenes.yaml";
  }
  fs::path folder_;
};

TEST_F(SceneFiles, AFileNamesScenesAndWhatIsMissing) {
  const fs::path file = write(R"(schema: segsim.table1/1
scenes:
  - name: one
    data: ScanNet
    source: {type: rgbd, folder: "${data}/scans/one", frame_step: 3}
    label_map: ${spec}/labels.yaml
    masks: ${data}/scans/one/masks
    shrink: 2
  - name: two
    title: The second
    data: ScanNet++
    source: {type: rgbd, folder: "${data}/scans/two"}
)");
  const panoptic::PanopticScenes list = panoptic::panoptic_scenes(file, folder_);
  ASSERT_EQ(list.scenes.size(), 1U);
  const panoptic::PanopticScene& one = list.scenes[0];
  EXPECT_EQ(one.source.folder, folder_ / "scans" / "one");
  EXPECT_EQ(one.source.frame_step, 3);
  EXPECT_EQ(one.label_map, folder_ / "labels.yaml");
  EXPECT_EQ(one.masks, folder_ / "scans" / "one" / "masks");
  EXPECT_EQ(one.shrink, 2);
  EXPECT_DOUBLE_EQ(one.zju_min_iou(), 0.1);
  ASSERT_EQ(list.missing.size(), 1U);
  EXPECT_THAT(list.missing[0].title, HasSubstr("The second"));
  EXPECT_THAT(list.missing[0].why, HasSubstr("scans/two"));

  EXPECT_THAT(error_of([&] { (void)panoptic::panoptic_scenes(file, folder_ / "elsewhere"); }),
              HasSubstr("a scene whose data is there"));
  EXPECT_THAT(
      error_of([&] { (void)panoptic::panoptic_scenes(write("schema: other\n"), folder_); }),
      HasSubstr("segsim.table1/1"));
  EXPECT_THAT(error_of([&] {
                (void)panoptic::panoptic_scenes(
                    write("schema: segsim.table1/1\nscenes:\n  - name: x\n    data: y\n"
                          "    source: {type: flat}\n    shrnk: 2\n"),
                    folder_);
              }),
              AllOf(HasSubstr("scenes.yaml:"), HasSubstr("shrnk")));
}

TEST_F(SceneFiles, ThePapersScenesAreListedAndNeedTheirData) {
  const std::string message = error_of([] {
    (void)panoptic::panoptic_scenes(SEGSIM_SCENE_LISTS "/table1_paper.yaml", "nowhere");
  });
  EXPECT_THAT(message, HasSubstr("ScanNet scene0087_02"));
  const panoptic::PanopticScenes list = panoptic::panoptic_scenes("flat-5", "");
  ASSERT_EQ(list.scenes.size(), 1U);
  EXPECT_EQ(list.scenes[0].source.seed, 5U);
  EXPECT_DOUBLE_EQ(list.scenes[0].zju_min_iou(), 0.3);
  EXPECT_THAT(list.missing.back().title, HasSubstr("5748ce6f01"));
  // A folder is recognised by its layout.
  const panoptic::PanopticScenes scan =
      panoptic::panoptic_scenes((folder_ / "scans" / "one").string(), "");
  EXPECT_EQ(scan.scenes.at(0).data, "ScanNet");
  EXPECT_EQ(scan.scenes.at(0).source.frame_step, 3);
}

TEST_F(SceneFiles, FiguresComeBackAsTheyWere) {
  panoptic::SceneFigures written = figures("a", "procedural", "query", 1.0 / 3.0);
  written.statistics.emplace_back("held_out_ssim", std::numeric_limits<double>::infinity());
  const fs::path file = folder_ / "a.json";
  panoptic::write_scene_figures(file, written);
  const panoptic::SceneFigures read = panoptic::read_scene_figures(file);
  EXPECT_EQ(read.recipe, written.recipe);
  EXPECT_EQ(read.statistics, written.statistics);
  EXPECT_EQ(read.mask_quality, written.mask_quality);
  ASSERT_EQ(read.rules.size(), 5U);
  EXPECT_EQ(read.rules[1].rules, "trajectory");
  EXPECT_EQ(read.rules[1].views, 7);
  EXPECT_EQ(read.rules[1].pq, 1.0 / 3.0);
  EXPECT_EQ(read.rules[1].weighted_coverage, 0.875);
  EXPECT_EQ(read.find("coco")->rules, "coco");
  EXPECT_EQ(read.find("other"), nullptr);

  fs::resize_file(file, fs::file_size(file) / 2);
  EXPECT_THROW((void)panoptic::read_scene_figures(file), core::InputError);
  std::ofstream(file, std::ios::trunc) << R"({"schema": "segsim.table1.scene/1"})";
  EXPECT_THROW((void)panoptic::read_scene_figures(file), core::InputError);
}

}  // namespace
}  // namespace segsim::experiments

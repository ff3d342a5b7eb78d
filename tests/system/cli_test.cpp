// The executable as a user runs it: exit codes, one-line errors, and the whole chain on a
// small room.

#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "segsim_process.h"

namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using ::testing::SizeIs;

using Output = segsim::tests::ProcessOutput;
using segsim::tests::expect_input_error;

Output segsim(const std::string& arguments) { return segsim::tests::run_segsim(arguments); }

void write(const fs::path& file, const std::string& text) {
  fs::create_directories(file.parent_path());
  std::ofstream(file, std::ios::binary) << text;
}

/// Writes boxes as Wavefront objects with a coloured material each.
class ObjWriter {
 public:
  void add_box(const std::string& name, std::array<double, 3> lo, std::array<double, 3> hi,
               const std::string& color) {
    materials_ << "newmtl m" << count_ << "\nKd " << color << "\n";
    faces_ << "o " << name << "\nusemtl m" << count_ << "\n";
    for (int i = 0; i < 8; ++i) {
      faces_ << "v " << ((i & 1) != 0 ? hi : lo)[0] << " " << ((i & 2) != 0 ? hi : lo)[1]
             << " " << ((i & 4) != 0 ? hi : lo)[2] << "\n";
    }
    constexpr int kFaces[6][4] = {{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4},
                                  {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}};
    for (const auto& face : kFaces) {
      faces_ << "f";
      for (const int corner : face) faces_ << " " << 8 * count_ + corner + 1;
      faces_ << "\n";
    }
    ++count_;
  }
  void save(const fs::path& file) const {
    write(file.parent_path() / "room.mtl", materials_.str());
    write(file, "mtllib room.mtl\n" + faces_.str());
  }

 private:
  std::ostringstream faces_, materials_;
  int count_ = 0;
};

/// 6 x 5 m room, y up as Wavefront files are: couch at one end, a table in the middle.
void write_room(const fs::path& file) {
  ObjWriter obj;
  obj.add_box("floor", {-3.0, -0.1, -2.5}, {3.0, 0.0, 2.5}, "0.6 0.5 0.4");
  obj.add_box("wall_1", {-3.1, 0.0, -2.5}, {-3.0, 2.4, 2.5}, "0.8 0.8 0.7");
  obj.add_box("wall_2", {3.0, 0.0, -2.5}, {3.1, 2.4, 2.5}, "0.7 0.8 0.8");
  obj.add_box("wall_3", {-3.0, 0.0, -2.6}, {3.0, 2.4, -2.5}, "0.8 0.7 0.8");
  obj.add_box("wall_4", {-3.0, 0.0, 2.5}, {3.0, 2.4, 2.6}, "0.7 0.7 0.7");
  obj.add_box("wall_5", {-0.1, 0.0, -2.5}, {0.1, 2.4, 0.9}, "0.75 0.75 0.6");
  obj.add_box("ceiling", {-3.1, 2.4, -2.6}, {3.1, 2.5, 2.6}, "0.9 0.9 0.9");
  obj.add_box("couch", {1.6, 0.0, -2.4}, {2.9, 0.8, -1.6}, "0.8 0.1 0.1");
  obj.add_box("bed", {-2.9, 0.0, -2.4}, {-1.6, 0.5, -1.5}, "0.1 0.2 0.8");
  obj.save(file);
}

class Cli : public ::testing::Test {
 protected:
  Cli() : folder_(fs::temp_directory_path() / ("segsim_cli_" + std::to_string(::getpid()))) {
    fs::remove_all(folder_);
    fs::create_directories(folder_);
  }
  ~Cli() override { fs::remove_all(folder_); }
  [[nodiscard]] std::string at(const std::string& name) const {
    return (folder_ / name).string();
  }

  /// A valid recording of three frames: a wall 2 m ahead.
  void write_recording(const std::string& name) const {
    const fs::path folder = folder_ / name;
    fs::create_directories(folder);
    write(folder / "intrinsics.txt", "60 0 31.5\n0 60 23.5\n0 0 1\n");
    for (int i = 0; i < 3; ++i) {
      char stem[32];
      std::snprintf(stem, sizeof stem, "frame-%06d", i);
      cv::Mat color(48, 64, CV_8UC3), depth(48, 64, CV_16U, cv::Scalar(2000));
      cv::randu(color, 0, 255);
      cv::imwrite(folder / (std::string(stem) + ".color.png"), color);
      cv::imwrite(folder / (std::string(stem) + ".depth.png"), depth);
      write(folder / (std::string(stem) + ".pose.txt"),
            "0 0 1 " + std::to_string(0.1 * i) + "\n-1 0 0 0\n0 -1 0 1.2\n0 0 0 1\n");
    }
  }
  [[nodiscard]] Output reconstruct(const std::string& name) const {
    return segsim("reconstruct " + at(name) + " --floor-height 0 --out " + at("bundle"));
  }
  fs::path folder_;
};

TEST_F(Cli, HelpListsTheSubcommandsAndVersionPrints) {
  const Output help = segsim("--help");
  EXPECT_EQ(help.exit_code, 0);
  for (const char* name : {"run", "table", "capture", "reconstruct", "scene", "render",
                           "label", "detector", "episodes", "explain"}) {
    EXPECT_THAT(help.text, HasSubstr(name));
    EXPECT_EQ(segsim(std::string(name) + " --help").exit_code, 0);
  }
  EXPECT_EQ(segsim("--version").exit_code, 0);
  EXPECT_EQ(segsim("").exit_code, 2);
  EXPECT_EQ(segsim("fly").exit_code, 2);
}

TEST_F(Cli, TruncatedPngIsNamed) {
  write_recording("r");
  const fs::path file = folder_ / "r" / "frame-000001.depth.png";
  fs::resize_file(file, fs::file_size(file) / 2);
  expect_input_error(reconstruct("r"), "frame-000001.depth.png");
}

TEST_F(Cli, PoseWithNanIsNamed) {
  write_recording("r");
  write(folder_ / "r" / "frame-000002.pose.txt", "0 0 1 nan\n-1 0 0 0\n0 -1 0 1.2\n0 0 0 1\n");
  expect_input_error(reconstruct("r"), "frame-000002.pose.txt");
}

TEST_F(Cli, BadFrameIsSkippedOnRequestAndCounted) {
  write_recording("r");
  write(folder_ / "r" / "frame-000002.pose.txt", "0 0 1 nan\n-1 0 0 0\n0 -1 0 1.2\n0 0 0 1\n");
  const Output run = segsim("reconstruct " + at("r") +
                            " --on-bad-frame skip --floor-height 0 --out " + at("bundle"));
  EXPECT_THAT(run.text, HasSubstr("warning: "));
  EXPECT_THAT(run.text, HasSubstr("frame-000002"));
}

TEST_F(Cli, GravityIsOneDirectionAndNotAnAxisToo) {
  write_recording("r");
  const auto with = [&](const std::string& flags) {
    return segsim("reconstruct " + at("r") + " " + flags + " --out " + at("bundle"));
  };
  expect_input_error(with("--gravity 0 0 0"), "--gravity");
  expect_input_error(with("--gravity 0 nan -1"), "--gravity");
  expect_input_error(with("--gravity 0 0 -1 --up z"), "--gravity and --up");
  expect_input_error(with("--gravity 0 -1 0 --floor-height nan"), "--floor-height");
  EXPECT_EQ(with("--gravity 0 -1").exit_code, 2);
  EXPECT_FALSE(fs::exists(at("bundle")));
}

TEST_F(Cli, CheckTellsWhatIsHardAndDrawsIt) {
  write_recording("r");
  const fs::path file = folder_ / "r" / "frame-000001.depth.png";
  fs::resize_file(file, fs::file_size(file) / 2);
  const Output run =
      segsim("reconstruct " + at("r") + " --check --check-picture " + at("plan.png"));
  EXPECT_EQ(run.exit_code, 0) << run.text;
  EXPECT_THAT(run.text, HasSubstr("few frames: 2 frames"));
  EXPECT_THAT(run.text, HasSubstr("loading: frame frame-000001 skipped"));
  EXPECT_FALSE(cv::imread(at("plan.png")).empty());
  EXPECT_EQ(segsim("reconstruct " + at("nowhere") + " --check").exit_code, 2);
  EXPECT_EQ(segsim("reconstruct " + at("r") + " --check --out " + at("b")).exit_code, 2);
}

TEST_F(Cli, CloudsToStartFromAreChecked) {
  write_recording("r");
  const auto start = [&](const std::string& cloud) {
    return segsim("reconstruct " + at("r") + " --start " + at(cloud) + " --out " +
                  at("bundle"));
  };
  expect_input_error(start("none.pcd"), "none.pcd");
  write(folder_ / "cut.ply",
        "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\n"
        "property float z\nend_header\n1 2 3\n");
  expect_input_error(start("cut.ply"), "cut.ply");
  EXPECT_FALSE(fs::exists(at("bundle")));
}

TEST_F(Cli, IntrinsicsWithEightNumbersAreRefused) {
  write_recording("r");
  write(folder_ / "r" / "intrinsics.txt", "60 0 31.5\n0 60 23.5\n0 0\n");
  const Output run = reconstruct("r");
  EXPECT_EQ(run.exit_code, 2) << run.text;
  EXPECT_THAT(run.text, HasSubstr("intrinsics.txt"));
  EXPECT_THAT(run.text, HasSubstr("8"));
}

TEST_F(Cli, PlyWithoutRot3IsRefused) {
  std::string header = "ply\nformat ascii 1.0\nelement vertex 1\n";
  for (const char* name : {"x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0",
                           "scale_1", "rot_0", "rot_1", "rot_2"}) {
    header += std::string("property float ") + name + "\n";
  }
  write(folder_ / "s.ply", header + "end_header\n0 0 0 0 0 0 1 -3 -3 1 0 0\n");
  const Output run = segsim("render " + at("s.ply") + " --out " + at("v.png"));
  EXPECT_EQ(run.exit_code, 2) << run.text;
  EXPECT_THAT(run.text, HasSubstr("s.ply"));
  EXPECT_THAT(run.text, HasSubstr("rot_3"));
}

TEST_F(Cli, UnknownKeyInASpecNamesLineAndNearestKey) {
  write(folder_ / "spec.yaml", "schema: segsim.experiment/1\nname: x\nseeed: 3\n");
  const Output run = segsim("run " + at("spec.yaml") + " --work " + at("w"));
  EXPECT_EQ(run.exit_code, 2) << run.text;
  EXPECT_THAT(run.text, HasSubstr("spec.yaml"));
}

TEST_F(Cli, BadEpisodeFilesAreNamed) {
  write(folder_ / "cut.json.gz", "\x1f\x8b\x08");
  const Output cut = segsim("episodes import " + at("cut.json.gz"));
  EXPECT_EQ(cut.exit_code, 2);
  EXPECT_THAT(cut.text, HasSubstr("cut.json.gz"));
  const Output none = segsim("episodes import " + at("none.json.gz"));
  EXPECT_EQ(none.exit_code, 2);
  EXPECT_EQ(segsim("episodes").exit_code, 2);
  for (const char* name : {"generate", "validate", "import", "export"}) {
    EXPECT_EQ(segsim("episodes " + std::string(name) + " --help").exit_code, 0);
  }
  const Output nothing = segsim("explain " + at("nowhere"));
  EXPECT_EQ(nothing.exit_code, 2);
  EXPECT_THAT(nothing.text, HasSubstr("nowhere"));
}

TEST_F(Cli, DamagedBundleIsRefused) {
  fs::create_directories(folder_ / "b");
  EXPECT_EQ(segsim("scene inspect " + at("b")).exit_code, 2);
  EXPECT_EQ(segsim("scene inspect " + at("none")).exit_code, 2);
}

TEST_F(Cli, MissingTextureIsACountedWarning) {
  write_room(folder_ / "room.obj");
  std::ofstream(folder_ / "room.mtl", std::ios::app) << "map_Kd nowhere.png\n";
  const Output run = segsim("capture --mesh " + at("room.obj") + " --out " + at("cap") +
                            " --frames 2 --width 64 --height 48");
  EXPECT_EQ(run.exit_code, 0) << run.text;
  EXPECT_THAT(run.text, HasSubstr("nowhere.png"));
  EXPECT_THAT(run.text, HasSubstr("1 warnings"));
}

/// The whole chain on a room of two corners: an experiment with the oracle detector.
class Chain : public Cli {
 protected:
  void SetUp() override {
    write_room(folder_ / "room.obj");
    write(folder_ / "spec.yaml",
          "schema: segsim.experiment/1\n"
          "name: chain\n"
          "seed: 5\n"
          "robot: jackal-gentle\n"
          "control_period_s: 0.2\n"
          "time_limit_s: 60\n"
          "camera: {width: 128, height: 96, hfov_deg: 79}\n"
          "scenes:\n"
          "  - name: room\n"
          "    goals: [couch, bed]\n"
          "    episodes: 6\n"
          "    start_distance_m: [1, 8]\n"
          "    allow_visible_start: true\n"
          "    source:\n"
          "      type: mesh\n"
          "      world: " +
              at("room.obj") +
              "\n"
              "      voxel_m: 0.04\n"
              "      capture: {frames: 60, width: 160, height: 120}\n"
              "arms:\n"
              "  - {name: oracle, detector: oracle}\n");
  }
  [[nodiscard]] std::string run_arguments(const std::string& work) const {
    return "run " + at("spec.yaml") + " --work " + at(work);
  }
  /// The finished trials of a work folder without the columns of wall time.
  [[nodiscard]] std::vector<std::string> rows(const std::string& work) const {
    std::ifstream stream(folder_ / work / "trials.csv");
    std::string line;
    std::getline(stream, line);
    const std::vector<std::string> names = fields(line);
    std::vector<std::string> kept;
    while (std::getline(stream, line)) {
      const std::vector<std::string> values = fields(line);
      std::string row;
      for (std::size_t i = 0; i < std::min(names.size(), values.size()); ++i) {
        const std::string& name = names[i];
        // Times, and a number in the order in which trials ended.
        if (name == "wall_s" || name.ends_with("_ms") || name == "trial_id" ||
            name == "finished")
          continue;
        row += name + "=" + values[i] + " ";
      }
      kept.push_back(row);
    }
    return kept;
  }
  static std::vector<std::string> fields(const std::string& line) {
    std::vector<std::string> parts;
    std::istringstream stream(line);
    for (std::string part; std::getline(stream, part, ',');) parts.push_back(part);
    return parts;
  }
};

TEST_F(Chain, RunsToATableAndRepeatsItself) {
  const Output first = segsim(run_arguments("a"));
  ASSERT_EQ(first.exit_code, 0) << first.text;
  EXPECT_THAT(first.text, HasSubstr("/6"));

  const Output render = segsim("render " + at("a/scenes/room") +
                               " --pose 1.5 0 1.2 90 5 --out " + at("view.exr"));
  EXPECT_EQ(render.exit_code, 0) << render.text;
  const Output inspect = segsim("scene inspect " + at("a/scenes/room"));
  EXPECT_EQ(inspect.exit_code, 0) << inspect.text;
  EXPECT_THAT(inspect.text, HasSubstr("couch"));

  // Same spec and seed in another folder: identical trials.
  const Output second = segsim(run_arguments("b"));
  ASSERT_EQ(second.exit_code, 0) << second.text;
  EXPECT_THAT(rows("a"), SizeIs(6));
  EXPECT_EQ(rows("a"), rows("b"));
}

TEST_F(Chain, TrialsAreExplainedAndEpisodesTravel) {
  const Output run = segsim(run_arguments("a"));
  ASSERT_EQ(run.exit_code, 0) << run.text;
  EXPECT_THAT(run.text, HasSubstr("success: segsim-object"));

  const Output list = segsim("explain " + at("a"));
  EXPECT_EQ(list.exit_code, 0) << list.text;
  EXPECT_THAT(list.text, HasSubstr("of 6 trials failed"));
  const Output story = segsim("explain " + at("a") + " room/couch/00");
  EXPECT_EQ(story.exit_code, 0) << story.text;
  EXPECT_THAT(story.text, HasSubstr("find a couch"));
  const std::string number = story.text.substr(6, story.text.find(':') - 6);
  for (const char* part : {"-map.png", "-frames.png"}) {
    EXPECT_FALSE(cv::imread(at("a/explain/trial-" + number + part)).empty()) << part;
  }
  EXPECT_EQ(segsim("explain " + at("a") + " 99999").exit_code, 2);
  EXPECT_EQ(segsim("explain " + at("a") + " 1 --run 9").exit_code, 2);

  // Generate, validate, store.
  const std::string bundle = at("a/scenes/room"), set = at("set.jsonl");
  const std::string eye = " --width 128 --height 96 --pitch-down-deg 0 --camera-height 1.2";
  const Output made = segsim("episodes generate " + bundle + " -o " + set +
                             " --count 4 --goals couch,bed --allow-visible-start" + eye);
  ASSERT_EQ(made.exit_code, 0) << made.text;
  EXPECT_THAT(made.text, HasSubstr("4 episodes over 2 classes"));
  EXPECT_EQ(segsim("episodes generate " + bundle + " -o " + set + " --goals cauch").exit_code,
            2);
  const Output valid = segsim("episodes validate " + set + " " + bundle + " --store");
  EXPECT_EQ(valid.exit_code, 0) << valid.text;
  EXPECT_THAT(valid.text, HasSubstr("fine 4"));
  EXPECT_THAT(valid.text, HasSubstr("SR 4/4"));

  // To Habitat and back.
  const Output out = segsim("episodes export " + set + " " + bundle + " -o " + at("habitat"));
  ASSERT_EQ(out.exit_code, 0) << out.text;
  const Output bound = segsim("episodes import " + at("habitat/val.json.gz") + " --bundle " +
                              bundle + " -o " + at("back"));
  ASSERT_EQ(bound.exit_code, 0) << bound.text;
  EXPECT_THAT(bound.text, HasSubstr("4 episodes over 2 classes"));
  EXPECT_THAT(bound.text, ::testing::Not(HasSubstr("NOT RUNNABLE")));
  const Output unbound = segsim("episodes import " + at("habitat/val.json.gz"));
  EXPECT_EQ(unbound.exit_code, 0);
  EXPECT_THAT(unbound.text, HasSubstr("NOT RUNNABLE"));

  // A start outside the floor is found, and such a set is flagged.
  std::ifstream stream(set);
  std::string text((std::istreambuf_iterator<char>(stream)), {});
  const std::size_t start = text.find("\"start\":[") + 9;
  text.replace(start, text.find(',', start) - start, "50.0");
  write(folder_ / "off.jsonl", text);
  const Output off = segsim("episodes validate " + at("off.jsonl") + " " + bundle);
  EXPECT_EQ(off.exit_code, 1) << off.text;
  EXPECT_THAT(off.text, HasSubstr("off the navmesh"));
  EXPECT_THAT(off.text, HasSubstr("FLAGGED"));
}

TEST_F(Chain, KilledRunGoesOnAndGivesTheSameTable) {
  ASSERT_EQ(segsim(run_arguments("whole")).exit_code, 0);

  const pid_t child = ::fork();
  ASSERT_GE(child, 0);
  if (child == 0) {
    const std::string spec = at("spec.yaml");
    const std::string work = at("killed");
    if (::freopen("/dev/null", "w", stdout) == nullptr) std::_Exit(126);
    if (::freopen("/dev/null", "w", stderr) == nullptr) std::_Exit(126);
    ::execl(SEGSIM_BINARY, SEGSIM_BINARY, "run", spec.c_str(), "--work", work.c_str(),
            nullptr);
    std::_Exit(127);
  }
  // Kill it as soon as the store exists and holds something, or after a minute.
  for (int i = 0; i < 600; ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    std::error_code error;
    if (fs::exists(at("killed/results.sqlite"), error) &&
        fs::exists(at("killed/pictures"), error) &&
        !fs::is_empty(at("killed/pictures"), error)) {
      break;
    }
  }
  ::kill(child, SIGKILL);
  int status = 0;
  ::waitpid(child, &status, 0);

  const Output again = segsim(run_arguments("killed"));
  ASSERT_EQ(again.exit_code, 0) << again.text;
  EXPECT_THAT(rows("whole"), SizeIs(6));
  EXPECT_EQ(rows("whole"), rows("killed"));
}

}  // namespace

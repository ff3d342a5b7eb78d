// Sensors of a spec: what is read, what is refused, what a run leaves behind.
#include <fstream>
#include <sstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "core/error.h"
#include "core/file_io.h"
#include "experiments/commands/commands.h"
#include "experiments/records/replay_log.h"
#include "experiments/records/store.h"
#include "experiments/runs/run.h"
#include "experiments/scripted_trials/scripted_run.h"
#include "experiments/support/gzip_file.h"
#include "experiments/trials/sensor_files.h"
#include "tests/error_message.h"
#include "tests/experiments/tiny_scene.h"
#include "tests/experiments/tiny_spec.h"

namespace segsim::experiments {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

const std::string kSpec =
    TinySpec{.name = "sensed",
             .episodes = 2,
             .arms = R"(  - {name: one, detector: oracle}
  - {name: other, detector: oracle, policy: {type: frontier}}
)",
             .time_limit_s = 20.0,
             .image_width_px = 64,
             .more = R"(success: {profile: segsim-object, distance_m: 1.0, visible_pixels: 20}
pictures: false
replays: {of: all, images: true}
)"}
        .text();

const char* const kSensors = R"(localisation: {type: noisy, position_m: {sigma: 0.01}}
sensors:
  camera: {exposure_ms: 30, sub_poses: 3, full_well: 4000, read_noise: 10, jpeg_quality: 85,
           hole_limit: 0.3, depth: {noise: kinect-axial, flying_pixels: 0.5, grazing_limit_deg: 82}}
  lidar: {rate_hz: 4, beams: 31, sweep_ms: 15, latency_ms: 20}
  imu: {rate_hz: 20, gyro_radps: {sigma: 0.01}}
  odometry: {}
  gps: {rate_hz: 2, phase_ms: 100, error_m: {drift_time_s: 60}}
  compass: {rate_hz: 2, declination_deg: 3.5}
)";

specs::ExperimentSpec parse(const std::string& more) {
  specs::SpecFolders folders{"data", "work"};
  return specs::parse_spec(kSpec + more, "sensed.yaml", folders);
}

TEST(SensorSpec, ReadsWhatIsThere) {
  const specs::ExperimentSpec spec = parse(kSensors);
  ASSERT_TRUE(spec.sensors.has_value());
  const sim::SensorSettings& s = *spec.sensors;
  EXPECT_DOUBLE_EQ(s.camera.rgb.exposure_s, 0.03);
  EXPECT_EQ(s.camera.rgb.sub_poses, 3);
  EXPECT_EQ(s.camera.rgb.full_well_e, 4000.0);
  EXPECT_EQ(s.camera.rgb.jpeg_quality, 85);
  EXPECT_EQ(s.camera.hole_limit, 0.3);
  EXPECT_EQ(s.camera.depth.noise, sim::DepthNoise::kKinectAxial);
  EXPECT_EQ(s.camera.depth.flying_pixels, 0.5);
  EXPECT_NEAR(s.camera.depth.grazing_limit_rad, 1.43117, 1e-5);
  EXPECT_EQ(s.lidar->period_ns, 250'000'000);
  EXPECT_EQ(s.lidar->latency_ns, 20'000'000);
  EXPECT_EQ(s.lidar->model.beams, 31);
  EXPECT_NEAR(s.lidar->model.first_rad, -2.35619, 1e-9) << "the default";
  EXPECT_DOUBLE_EQ(s.lidar->model.sweep_s, 0.015);
  EXPECT_EQ(s.imu->model.gyro_radps.sigma, 0.01);
  EXPECT_EQ(s.imu->model.gyro_radps.drift, 0.005) << "the default";
  EXPECT_EQ(s.odometry->period_ns, 20'000'000);
  EXPECT_EQ(s.gps->phase_ns, 100'000'000);
  EXPECT_EQ(s.gps->model.horizontal_m.drift_time_s, 60.0);
  EXPECT_NEAR(s.compass->model.declination_rad, 0.0610865, 1e-6);
  ASSERT_TRUE(spec.localisation.localiser.has_value());
  EXPECT_EQ(spec.localisation.localiser->position_m.sigma, 0.01);
  EXPECT_FALSE(spec.localisation.odometry);

  const specs::ExperimentSpec plain = parse("");
  EXPECT_FALSE(plain.sensors.has_value());
  EXPECT_FALSE(plain.localisation.localiser || plain.localisation.odometry);
  EXPECT_TRUE(parse("localisation: odom\n").localisation.odometry);
  EXPECT_TRUE(parse("localisation: noisy\n").localisation.localiser.has_value());
  const sim::SensorSettings depth = *parse("sensors: {camera: {depth: redwood}}\n").sensors;
  EXPECT_EQ(depth.camera.depth.noise, sim::DepthNoise::kRedwood);
  EXPECT_FALSE(depth.lidar || depth.imu || depth.gps);
}

TEST(SensorSpec, RefusesWithLineAndNearestKey) {
  const auto error = [](const std::string& more) {
    return tests::input_error_of([&] { (void)parse(more); });
  };
  EXPECT_THAT(error("sensors:\n  imu: {}\n  lidr: {}\n"), HasSubstr("sensed.yaml:23"));
  EXPECT_THAT(error("sensors:\n  imu: {}\n  lidr: {}\n"), HasSubstr("lidar"));
  EXPECT_THAT(error("sensors:\n  camera: {jpeg_quality: 101}\n"), HasSubstr("[1, 100]"));
  EXPECT_THAT(error("sensors:\n  camera: {depth: kinect}\n"), HasSubstr("kinect-axial"));
  EXPECT_THAT(error("sensors:\n  camera: {depth: {flying_pixel: 0.1}}\n"),
              HasSubstr("flying_pixels"));
  EXPECT_THAT(error("sensors:\n  camera: {sub_poses: 3}\n"), HasSubstr("exposure_ms"));
  EXPECT_THAT(error("sensors:\n  camera: {read_noise: 3}\n"), HasSubstr("full_well"));
  EXPECT_THAT(error("sensors:\n  lidar: {rate_hz: 0}\n"), HasSubstr("rate_hz"));
  EXPECT_THAT(error("sensors:\n  lidar: {first_deg: 10, last_deg: -10}\n"),
              HasSubstr("first_deg < last_deg"));
  EXPECT_THAT(error("sensors:\n  lidar: {rate_hz: 50, sweep_ms: 21}\n"), HasSubstr("[0, 20]"));
  EXPECT_THAT(error("sensors:\n  gps: {error_m: {sigma: -1}}\n"), HasSubstr("sigma"));
  EXPECT_THAT(error("sensors:\n  gps: {error_m: {sigma: nan}}\n"), HasSubstr("sigma"));
  EXPECT_THAT(error("localisation: perfekt\n"), HasSubstr("perfect"));
  EXPECT_THAT(error("localisation: {type: odom, rate_hz: 3}\n"), HasSubstr("rate_hz"));
}

class SensorRun : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TemporaryFolder("sensors");
    TinyScene().write(folder_->path() / "tiny");
    run("with", kSpec + kSensors, 2);
  }
  static void TearDownTestSuite() { delete folder_; }
  static void run(const std::string& work, const std::string& text, int workers) {
    runs::RunOptions options;
    options.folders = {folder_->path(), folder_->path() / work};
    options.workers = workers;
    (void)runs::run_experiment(specs::parse_spec(text, "sensed.yaml", options.folders),
                               options);
  }
  static fs::path sensors(const std::string& work, const std::string& arm = "one") {
    return folder_->path() / work / "sensors" / "tiny" / ("couch-00." + arm);
  }
  static std::vector<std::uint64_t> hashes(const std::string& work) {
    const records::Store store(folder_->path() / work / "results.sqlite");
    std::vector<std::uint64_t> found;
    for (const records::TrialRow& row : store.trials(store.runs().back().run_id)) {
      EXPECT_EQ(row.error, "");
      found.push_back(row.state_hash);
    }
    return found;
  }
  static std::string replay(const fs::path& path, const std::string& flags) {
    CLI::App app;
    commands::add_replay_command(app);
    try {
      app.parse("replay " + path.string() + " " + flags + " --data " +
                folder_->path().string());
      return "";
    } catch (const std::exception& error) {
      return error.what();
    }
  }
  static TemporaryFolder* folder_;
};
TemporaryFolder* SensorRun::folder_ = nullptr;

std::vector<std::string> lines_of(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream in(text);
  for (std::string line; std::getline(in, line);) lines.push_back(line);
  return lines;
}

TEST_F(SensorRun, LeavesFiles) {
  const fs::path folder = sensors("with");
  const auto imu = lines_of(core::read_file(folder / "imu.csv"));
  EXPECT_EQ(imu[0].substr(0, 34), "time_s,available_s,accel_x_mps2,ac");
  EXPECT_EQ(imu[1].substr(0, 24), "0.050000000,0.050000000,");
  const auto gps = lines_of(core::read_file(folder / "gps.csv"));
  EXPECT_EQ(gps[1].substr(0, 28), "0.100000000,0.100000000,49.9");
  const auto lidar = lines_of(support::read_gzip(folder / "lidar.csv.gz"));
  EXPECT_THAT(lidar[0], HasSubstr(",range_30_m"));
  EXPECT_EQ(lidar[1].substr(0, 23), "0.000000000,0.035000000");
  EXPECT_EQ(std::count(lidar[1].begin(), lidar[1].end(), ','), 32);
  const auto camera = lines_of(core::read_file(folder / "camera.csv"));
  EXPECT_EQ(camera[0],
            "time_s,available_s,mean_alpha,hole_share,view_distance_m,view_angle_deg,"
            "render_invalid");
  EXPECT_THAT(camera[1], HasSubstr(",,")) << "this bundle kept no cameras";
  EXPECT_TRUE(fs::exists(folder / "compass.csv"));
  EXPECT_TRUE(fs::exists(folder / "odometry.csv"));
  const auto summary = nlohmann::json::parse(core::read_file(folder / "summary.json"));
  EXPECT_EQ(summary.at("camera").at("images").get<std::size_t>(), camera.size() - 1);
  EXPECT_EQ(summary.at("sensors").at("imu").at("readings").get<std::size_t>(), imu.size() - 1);
  EXPECT_EQ(summary.at("sensors").at("lidar").at("beams").get<int>(), 31);
  EXPECT_TRUE(summary.at("camera").at("mean_view_distance_m").is_null());
}

TEST_F(SensorRun, NoiseIsOfTheEpisodeAndNotOfTheArm) {
  // Both arms are the same policy with the same detector.
  for (const char* file : {"imu.csv", "gps.csv", "camera.csv", "odometry.csv"}) {
    EXPECT_EQ(core::read_file(sensors("with") / file),
              core::read_file(sensors("with", "other") / file));
  }
  run("serial", kSpec + kSensors, 1);
  EXPECT_EQ(hashes("serial"), hashes("with")) << "whatever the number of workers";
  EXPECT_EQ(core::read_file(sensors("serial") / "summary.json"),
            core::read_file(sensors("with") / "summary.json"));
}

TEST_F(SensorRun, SensorsThatNobodyReadsChangeNoTrial) {
  run("without", kSpec, 2);
  run("recorded", kSpec + "sensors: {lidar: {rate_hz: 3, beams: 9}, imu: {}, gps: {}}\n", 2);
  EXPECT_EQ(hashes("recorded"), hashes("without"));
  EXPECT_NE(hashes("with"), hashes("without")) << "localisation is read";
  EXPECT_FALSE(fs::exists(sensors("without")));
  EXPECT_TRUE(fs::exists(sensors("recorded") / "imu.csv"));
}

TEST_F(SensorRun, ReplaysEqualAndNamesTheSensorThatDiffers) {
  const fs::path logs = folder_->path() / "with" / "replays";
  EXPECT_EQ(replay(logs, "--verify"), "");
  EXPECT_EQ(replay(logs, "--verify --from-log"), "") << "images of the exposure, too";

  const fs::path log = logs / "tiny" / "couch-00.one.jsonl";
  records::ReplayLog recorded = records::read_replay_log(log);
  ASSERT_EQ(recorded.sensors.size(), 5U);
  EXPECT_EQ(recorded.sensors[1].sensor, "imu");
  recorded.sensors[1].hash ^= 1U;
  const fs::path changed = folder_->path() / "changed" / "replays" / "tiny" / log.filename();
  fs::create_directories(changed.parent_path());
  records::write_replay_log(changed, recorded);
  testing::internal::CaptureStdout();
  const std::string message =
      replay(changed, "--verify --work " + (folder_->path() / "with").string());
  EXPECT_THAT(testing::internal::GetCapturedStdout(),
              HasSubstr("differs in the readings of imu"));
  EXPECT_THAT(message, HasSubstr("1 of 1"));
}

TEST_F(SensorRun, ScriptedTrialsHaveThemToo) {
  const std::string script = R"(schema: segsim.trial/1
scene: tiny
seed: 17
start: {pose: [-2.5, -1.2, 0.0]}
camera: {width: 64, height: 48}
steps:
  - cmd:  {v: 0.3, w: 0.4, for_s: 2.0}
  - hold: {for_s: 0.5}
)";
  const auto drive = [&script](const std::string& name, const std::string& more) {
    const scripted_trials::ScriptedTrial trial = scripted_trials::parse_scripted_trial(
        script + more, folder_->path() / (name + ".yaml"), folder_->path());
    scripted_trials::BoundScript bound = scripted_trials::bind_script(trial);
    return scripted_trials::run_script(bound, folder_->path() / name);
  };
  const scripted_trials::ScriptedResult plain = drive("plain", "");
  const scripted_trials::ScriptedResult sensed =
      drive("sensed", "sensors: {imu: {}, gps: {}}\n");
  EXPECT_EQ(sensed.trial.state_hash, plain.trial.state_hash);
  EXPECT_FALSE(fs::exists(folder_->path() / "plain" / "sensors"));
  const auto imu = lines_of(core::read_file(folder_->path() / "sensed/sensors/imu.csv"));
  EXPECT_EQ(imu.size() - 1, sensed.trial.sensors.imu.size());
  EXPECT_GT(imu.size(), 100U);
  const scripted_trials::ScriptedResult lost = drive("lost", "localisation: noisy\n");
  EXPECT_NE(lost.trial.final_estimate.x_m, lost.trial.track.back().pose.x_m);
  EXPECT_EQ(plain.trial.final_estimate.x_m, plain.trial.track.back().pose.x_m);
}

TEST(SensorFiles, OfAnEarlierTrialGo) {
  const TemporaryFolder folder("sensor_files");
  sim::SensorSettings settings;
  sim::SensorLog log;
  log.imu.push_back({20'000'000, 21'000'000, {}});
  log.lidar.push_back({0, 0, {1.0F, std::nanf(""), 2.5F}});
  trials::write_sensor_files(folder.path(), settings, log);
  EXPECT_EQ(lines_of(support::read_gzip(folder.path() / "lidar.csv.gz"))[1],
            "0.000000000,0.000000000,1.0000,,2.5000");
  EXPECT_EQ(lines_of(core::read_file(folder.path() / "imu.csv"))[1],
            "0.020000000,0.021000000,0,0,0,0,0,0");
  trials::write_sensor_files(folder.path(), settings, {});
  EXPECT_FALSE(fs::exists(folder.path() / "imu.csv"));
  EXPECT_FALSE(fs::exists(folder.path() / "lidar.csv.gz"));
  EXPECT_TRUE(fs::exists(folder.path() / "summary.json"));
}

}  // namespace
}  // namespace segsim::experiments

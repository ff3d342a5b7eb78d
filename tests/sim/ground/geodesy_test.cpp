#include "sim/ground/geodesy.h"

#include <cmath>
#include <numbers>
#include <string>

#include <gtest/gtest.h>
#include <glm/geometric.hpp>

#include "core/file_io.h"
#include "core/random.h"

namespace segsim::sim {
namespace {

struct Known {
  core::GeodeticOrigin origin;
  glm::dvec3 enu_m;
  GeodeticPoint point;
};

TEST(LocalFrame, KnownPoints) {
  const core::GeodeticOrigin darmstadt{49.9, 8.9, 0.0, 0.0};
  const core::GeodeticOrigin hangzhou{30.263, 120.123, 10.0, 0.0};
  const Known known[] = {
      {darmstadt, {10, 20, 0}, {49.9001798121, 8.9001391903, 0.000039}},
      {darmstadt, {100, 0, 0}, {49.8999999916, 8.9013918978, 0.000782}},
      {darmstadt, {0, 100, 0}, {49.9008990611, 8.9, 0.000784}},
      {hangzhou, {10, 20, 0}, {30.2631804125, 120.1231039168, 10.000039}},
  };
  for (const Known& k : known) {
    const GeodeticPoint found = LocalFrame(k.origin).to_geodetic(k.enu_m);
    EXPECT_NEAR(found.latitude_deg, k.point.latitude_deg, 1e-10);
    EXPECT_NEAR(found.longitude_deg, k.point.longitude_deg, 1e-10);
    EXPECT_NEAR(found.height_m, k.point.height_m, 3e-6);
  }
}

TEST(LocalFrame, RoundTripsToNanometres) {
  core::RandomStream random(1, "points");
  for (int k = 0; k < 200; ++k) {
    const LocalFrame frame({random.uniform(-80, 80), random.uniform(-180, 180),
                            random.uniform(-10, 500), random.uniform(-3, 3)});
    const glm::dvec3 p(random.uniform(-500, 500), random.uniform(-500, 500),
                       random.uniform(-5, 5));
    EXPECT_LT(glm::distance(frame.from_geodetic(frame.to_geodetic(p)), p), 1e-8);
  }
}

TEST(LocalFrame, YawTurnsTheWorld) {
  const LocalFrame straight({49.9, 8.9, 0.0, 0.0});
  const LocalFrame turned({49.9, 8.9, 0.0, std::numbers::pi / 2});
  // World x points north then.
  const GeodeticPoint a = turned.to_geodetic({30, 0, 0});
  const GeodeticPoint b = straight.to_geodetic({0, 30, 0});
  EXPECT_NEAR(a.latitude_deg, b.latitude_deg, 1e-12);
  EXPECT_NEAR(a.longitude_deg, b.longitude_deg, 1e-12);
}

/// Minimal JSON checker: one value; moves `at` behind it.
bool skip_json(const std::string& s, std::size_t& at);

void skip_space(const std::string& s, std::size_t& at) {
  while (at < s.size() && std::isspace(static_cast<unsigned char>(s[at])) != 0) ++at;
}

bool skip_string(const std::string& s, std::size_t& at) {
  if (at >= s.size() || s[at] != '"') return false;
  for (++at; at < s.size() && s[at] != '"'; ++at) {
    if (static_cast<unsigned char>(s[at]) < 0x20) return false;
    if (s[at] == '\\') ++at;
  }
  return at++ < s.size();
}

bool skip_list(const std::string& s, std::size_t& at, char close, bool keyed) {
  ++at;
  skip_space(s, at);
  if (at < s.size() && s[at] == close) return ++at, true;
  while (true) {
    skip_space(s, at);
    if (keyed) {
      if (!skip_string(s, at)) return false;
      skip_space(s, at);
      if (at >= s.size() || s[at++] != ':') return false;
    }
    if (!skip_json(s, at)) return false;
    skip_space(s, at);
    if (at >= s.size()) return false;
    const char c = s[at++];
    if (c == close) return true;
    if (c != ',') return false;
  }
}

bool skip_json(const std::string& s, std::size_t& at) {
  skip_space(s, at);
  if (at >= s.size()) return false;
  if (s[at] == '{') return skip_list(s, at, '}', true);
  if (s[at] == '[') return skip_list(s, at, ']', false);
  if (s[at] == '"') return skip_string(s, at);
  std::size_t used = 0;
  try {
    static_cast<void>(std::stod(s.substr(at, 40), &used));
  } catch (const std::exception&) {
    return false;
  }
  at += used;
  return true;
}

/// Whether tags nest; attributes and text are skipped.
bool tags_balance(const std::string& s) {
  std::vector<std::string> open;
  for (std::size_t at = s.find('<'); at != std::string::npos; at = s.find('<', at)) {
    const std::size_t end = s.find('>', at);
    if (end == std::string::npos) return false;
    const std::string tag = s.substr(at + 1, end - at - 1);
    at = end;
    if (tag[0] == '?') continue;
    if (tag[0] == '/') {
      if (open.empty() || open.back() != tag.substr(1)) return false;
      open.pop_back();
    } else {
      open.push_back(tag.substr(0, tag.find(' ')));
    }
  }
  return open.empty();
}

class TrackFiles : public testing::Test {
 protected:
  TrackFiles() {
    track_.name = "flat 3, \"couch\" <7> & more\n";
    track_.positions_m = {{0, 0}, {10, 20}, {12, 20}};
    track_.goal_m = glm::dvec2(13, 21);
    track_.properties = {{"outcome", "success"}, {"path\\m", "24.4"}};
  }
  void TearDown() override { std::filesystem::remove(file_); }

  std::filesystem::path file_ =
      std::filesystem::path(testing::TempDir()) / "segsim_track_test";
  LocalFrame frame_{core::GeodeticOrigin{49.9, 8.9, 0.0, 0.0}};
  GeoTrack track_;
};

TEST_F(TrackFiles, GeoJsonIsWellFormedAndInLonLatOrder) {
  write_track_geojson(file_, frame_, track_);
  const std::string text = core::read_file(file_);
  std::size_t at = 0;
  EXPECT_TRUE(skip_json(text, at)) << text;
  skip_space(text, at);
  EXPECT_EQ(at, text.size());
  EXPECT_NE(text.find("[8.900139190,49.900179812,0.000]"), std::string::npos) << text;
  for (const char* word :
       {"LineString", "\"start\"", "\"end\"", "\"goal\"", "\"outcome\":\"success\""}) {
    EXPECT_NE(text.find(word), std::string::npos) << word;
  }
  // The checker can fail.
  at = 0;
  EXPECT_FALSE(skip_json(text.substr(0, text.size() - 3), at));
}

TEST_F(TrackFiles, KmlIsWellFormed) {
  write_track_kml(file_, frame_, track_);
  const std::string text = core::read_file(file_);
  EXPECT_TRUE(tags_balance(text)) << text;
  EXPECT_NE(text.find("&lt;7&gt; &amp; more"), std::string::npos);
  EXPECT_NE(text.find(" 8.900139190,49.900179812,0.000 "), std::string::npos);
  EXPECT_FALSE(tags_balance(text.substr(0, text.size() - 8)));
}

TEST_F(TrackFiles, ASinglePositionStillMakesALine) {
  track_.positions_m.resize(1);
  track_.goal_m.reset();
  write_track_geojson(file_, frame_, track_);
  const std::string text = core::read_file(file_);
  std::size_t at = 0;
  EXPECT_TRUE(skip_json(text, at));
  EXPECT_NE(text.find("0.000],[8.9"), std::string::npos) << text;
  EXPECT_EQ(text.find("goal"), std::string::npos);
}

}  // namespace
}  // namespace segsim::sim

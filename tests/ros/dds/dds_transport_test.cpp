#include "ros/dds/transport.h"

#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>

#include <algorithm>
#include <functional>
#include <map>

#include <dds/dds.h>
#include <dds/ddsi/ddsi_serdata.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/error.h"
#include "ros/dds/internal/discovery_info.h"
#include "ros/dds/internal/raw_type.h"
#include "ros/dds/topic_io.h"
#include "ros/messages/geometry_msgs.h"
#include "ros/messages/rmw_dds_common.h"
#include "ros/messages/rosgraph_msgs.h"
#include "ros/messages/sensor_msgs.h"
#include "ros/messages/std_msgs.h"
#include "tests/ros/dds/loopback.h"

extern char** environ;

namespace segsim::ros::dds {
namespace {

constexpr int kDomain = 71;
constexpr double kPatience_s = 30.0;

std::unique_ptr<Transport> open(Distro distro = Distro::kJazzy,
                                const std::string& node = "robot") {
  return open_transport(
      {.domain = kDomain, .distro = distro, .node = node, .config = kLoopback});
}
std::unique_ptr<Transport> open(Implementation implementation) {
  if (implementation == Implementation::kCyclone) return open();
  return open_transport({.domain = kDomain,
                         .node = "robot",
                         .config = kFastLoopback,
                         .implementation = Implementation::kFast});
}

/// Waits for messages and discovery. @return  Whether it came true.
bool comes_true(Transport& transport, const std::function<bool()>& condition) {
  for (double waited_s = 0.0; waited_s < kPatience_s; waited_s += 0.02) {
    if (condition()) return true;
    (void)transport.wait(0.02);
  }
  return false;
}

template <class M>
std::optional<M> next(Transport& transport, TopicReader<M>& reader) {
  std::optional<M> message;
  (void)comes_true(transport, [&] { return (message = reader.take()).has_value(); });
  return message;
}

/// Who writes, and who reads.
struct Pair {
  Implementation from, to;
};

class DdsTransports : public testing::TestWithParam<Pair> {
 protected:
  void SetUp() override {
    for (const Implementation one : {GetParam().from, GetParam().to}) {
      if (!has_transport(one)) GTEST_SKIP() << "built without it";
    }
  }
};

INSTANTIATE_TEST_SUITE_P(
    , DdsTransports,
    testing::Values(Pair{Implementation::kCyclone, Implementation::kCyclone},
                    Pair{Implementation::kFast, Implementation::kFast},
                    Pair{Implementation::kFast, Implementation::kCyclone},
                    Pair{Implementation::kCyclone, Implementation::kFast}),
    [](const auto& one) {
      const auto name = [](Implementation i) {
        return std::string(i == Implementation::kFast ? "Fast" : "Cyclone");
      };
      return name(one.param.from) + "To" + name(one.param.to);
    });

TEST_P(DdsTransports, MessagesComeAsTheyWereSent) {
  const auto from = open(GetParam().from), to = open(GetParam().to);
  TopicWriter<sensor_msgs::Image> writer(*from, "/image", {.depth = 5});
  TopicReader<sensor_msgs::Image> reader(*to, "/image", {.depth = 5});
  // Each side finds the other for itself.
  ASSERT_TRUE(comes_true(*to, [&] { return writer.readers() == 1 && reader.writers() == 1; }));
  sensor_msgs::Image sent;
  sent.header = {{3, 5}, "camera"};
  sent.encoding = "rgb8";
  sent.width = 641;
  sent.height = 3;
  sent.data.resize(641 * 3 * 3);  // No whole number of words.
  for (std::size_t k = 0; k < sent.data.size(); ++k)
    sent.data[k] = static_cast<std::uint8_t>(k);
  EXPECT_TRUE(writer.write(sent));
  EXPECT_EQ(next(*to, reader), sent);
  EXPECT_EQ(reader.take(), std::nullopt);
  EXPECT_FALSE(to->wait(0.01));
}

TEST_P(DdsTransports, AMessageOfAnotherTypeIsNotHeard) {
  const auto from = open(GetParam().from), to = open(GetParam().to);
  TopicWriter<std_msgs::String> writer(*from, "/mixed");
  TopicReader<std_msgs::Bool> other(*to, "/mixed");
  TopicReader<std_msgs::String> same(*from, "/mixed");
  ASSERT_TRUE(comes_true(*to, [&] { return writer.readers() == 1 && same.writers() == 1; }));
  EXPECT_TRUE(writer.write({"text"}));
  EXPECT_EQ(next(*from, same), std_msgs::String{"text"});
  EXPECT_EQ(other.writers(), 0);
}

TEST_P(DdsTransports, WhoComesLateGetsTheLastMessagesOfALatchedTopicAlone) {
  const auto from = open(GetParam().from);
  TopicWriter<std_msgs::String> latched(*from, "/latched",
                                        {.transient_local = true, .depth = 1});
  TopicWriter<std_msgs::String> passing(*from, "/passing", {.depth = 1});
  for (const char* text : {"old", "new"}) {
    EXPECT_TRUE(latched.write({text}));
    EXPECT_TRUE(passing.write({text}));
  }
  const auto to = open(GetParam().to);
  TopicReader<std_msgs::String> late(*to, "/latched", {.transient_local = true, .depth = 10});
  TopicReader<std_msgs::String> too_late(*to, "/passing", {.depth = 10});
  EXPECT_EQ(next(*to, late), std_msgs::String{"new"});
  EXPECT_EQ(late.take(), std::nullopt);
  ASSERT_TRUE(
      comes_true(*to, [&] { return passing.readers() == 1 && too_late.writers() == 1; }));
  EXPECT_TRUE(passing.write({"now"}));
  EXPECT_EQ(next(*to, too_late), std_msgs::String{"now"});
}

TEST_P(DdsTransports, ABestEffortReaderHearsReliableWritersButNotTheOtherWayRound) {
  const auto from = open(GetParam().from), to = open(GetParam().to);
  TopicWriter<std_msgs::Bool> reliable(*from, "/a"),
      unreliable(*from, "/b", {.reliable = false});
  TopicReader<std_msgs::Bool> careless(*to, "/a", {.reliable = false}),
      careful(*to, "/b", {.reliable = true}), fits(*to, "/b", {.reliable = false});
  ASSERT_TRUE(comes_true(*to, [&] {
    return reliable.readers() == 1 && careless.writers() == 1 && fits.writers() == 1;
  }));
  EXPECT_EQ(unreliable.readers(), 1);
  EXPECT_EQ(careful.writers(), 0);
}

TEST(DdsTransport, RefusesNamesThatAreNoTopics) {
  const auto transport = open();
  EXPECT_THROW((void)transport->make_writer(topic_of<std_msgs::Bool>("stop")),
               core::InputError);
  EXPECT_THROW((void)transport->make_reader(topic_of<std_msgs::Bool>("/")), core::InputError);
}

// What another participant sees of ours, by Cyclone's own interface.

std::string user_data(const dds_qos_t* qos) {
  void* data = nullptr;
  std::size_t size = 0;
  if (!dds_qget_userdata(qos, &data, &size) || data == nullptr) return {};
  std::string text(static_cast<const char*>(data), size);
  dds_free(data);
  return text;
}

/// A plain participant in the same domain.
class Onlooker {
 public:
  Onlooker() : participant_(dds_create_participant(kDomain, nullptr, nullptr)) {}
  ~Onlooker() { dds_delete(participant_); }
  Onlooker(const Onlooker&) = delete;
  Onlooker& operator=(const Onlooker&) = delete;

  /// USER_DATA of all other participants that have any.
  std::vector<std::string> participants() const {
    std::vector<std::string> found;
    read<dds_builtintopic_participant_t>(
        DDS_BUILTIN_TOPIC_DCPSPARTICIPANT,
        [&](const auto& one) { found.push_back(user_data(one.qos)); });
    std::erase(found, "");
    return found;
  }
  /// Type and USER_DATA by the topic's name. @param topic  Of publications or subscriptions.
  std::map<std::string, std::pair<std::string, std::string>> endpoints(
      dds_entity_t topic) const {
    std::map<std::string, std::pair<std::string, std::string>> found;
    read<dds_builtintopic_endpoint_t>(topic, [&](const auto& one) {
      found[one.topic_name] = {one.type_name, user_data(one.qos)};
    });
    return found;
  }
  /// Of endpoints, by the topic's name.
  std::map<std::string, dds_guid_t> guids(dds_entity_t topic) const {
    std::map<std::string, dds_guid_t> found;
    read<dds_builtintopic_endpoint_t>(
        topic, [&](const auto& one) { found[one.topic_name] = one.key; });
    return found;
  }

 private:
  template <class Entry, class Receive>
  void read(dds_entity_t topic, const Receive& receive) const {
    const dds_entity_t reader = dds_create_reader(participant_, topic, nullptr, nullptr);
    void* samples[64] = {};
    dds_sample_info_t infos[64];
    const int count = dds_read(reader, samples, infos, 64, 64);
    for (int k = 0; k < count; ++k) {
      const bool alive = infos[k].instance_state == DDS_IST_ALIVE;
      if (infos[k].valid_data && alive) receive(*static_cast<const Entry*>(samples[k]));
    }
    if (count > 0) dds_return_loan(reader, samples, count);
    dds_delete(reader);
  }
  dds_entity_t participant_;
};

TEST(DdsTransport, ShowsItselfAsNodesOfRos2Do) {
  const auto transport = open();
  TopicWriter<rosgraph_msgs::Clock> clock(*transport, "/clock");
  TopicReader<geometry_msgs::Twist> command(*transport, "/cmd_vel");
  const Onlooker onlooker;
  EXPECT_THAT(onlooker.participants(), testing::ElementsAre("enclave=/;"));
  const auto writers = onlooker.endpoints(DDS_BUILTIN_TOPIC_DCPSPUBLICATION);
  EXPECT_EQ(
      writers.at("rt/clock"),
      std::pair(std::string("rosgraph_msgs::msg::dds_::Clock_"),
                std::string("typehash=RIHS01_692f7a66e93a3c83e71765d033b60349ba68023a8c68"
                            "9a79e48078bcb5c58564;")));
  EXPECT_EQ(writers.at("ros_discovery_info").first,
            "rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_");
  const auto readers = onlooker.endpoints(DDS_BUILTIN_TOPIC_DCPSSUBSCRIPTION);
  EXPECT_EQ(
      readers.at("rt/cmd_vel"),
      std::pair(std::string("geometry_msgs::msg::dds_::Twist_"),
                std::string("typehash=RIHS01_9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46"
                            "bd2e609fcddde6fb8d2a;")));
}

TEST(DdsTransport, FastDdsShowsTheSame) {
  if (!has_transport(Implementation::kFast)) GTEST_SKIP() << "built without it";
  const auto domain = open(), robot = open(Implementation::kFast);
  TopicWriter<rosgraph_msgs::Clock> clock(*robot, "/clock");
  const Onlooker onlooker;
  std::map<std::string, std::pair<std::string, std::string>> writers;
  EXPECT_TRUE(comes_true(*domain, [&] {
    writers = onlooker.endpoints(DDS_BUILTIN_TOPIC_DCPSPUBLICATION);
    return writers.contains("rt/clock");
  }));
  EXPECT_EQ(writers["rt/clock"].first, "rosgraph_msgs::msg::dds_::Clock_");
  EXPECT_THAT(writers["rt/clock"].second, testing::StartsWith("typehash=RIHS01_692f7a66"));
  EXPECT_THAT(onlooker.participants(), testing::ElementsAre("enclave=/;", "enclave=/;"));
}

TEST(DdsTransport, InHumbleNoTypeHashIsTold) {
  const auto transport = open(Distro::kHumble);
  TopicWriter<rosgraph_msgs::Clock> clock(*transport, "/clock");
  const auto writers = Onlooker().endpoints(DDS_BUILTIN_TOPIC_DCPSPUBLICATION);
  EXPECT_EQ(writers.at("rt/clock").second, "");
}

/// What the newest `ros_discovery_info` says; it has no "rt/", so the interface cannot ask.
rmw_dds_common::ParticipantEntitiesInfo told_by(Transport& transport) {
  const dds_entity_t participant = dds_create_participant(kDomain, nullptr, nullptr);
  const Topic topic = internal::discovery_topic(Distro::kJazzy);
  ddsi_sertype* type = internal::make_raw_type(topic.type_name);
  const dds_entity_t entity = dds_create_topic_sertype(participant, topic.name.c_str(), &type,
                                                       nullptr, nullptr, nullptr);
  dds_qos_t* qos = dds_create_qos();
  dds_qset_reliability(qos, DDS_RELIABILITY_RELIABLE, 0);
  dds_qset_durability(qos, DDS_DURABILITY_TRANSIENT_LOCAL);
  const dds_entity_t reader = dds_create_reader(participant, entity, qos, nullptr);
  dds_delete_qos(qos);
  ddsi_serdata* sample = nullptr;
  dds_sample_info_t info;
  EXPECT_TRUE(comes_true(
      transport, [&] { return dds_takecdr(reader, &sample, 1, &info, DDS_ANY_STATE) == 1; }));
  std::vector<std::byte> cdr;
  internal::copy_raw_sample(sample, cdr);
  ddsi_serdata_unref(sample);
  dds_delete(participant);
  return decode_cdr<rmw_dds_common::ParticipantEntitiesInfo>(cdr, topic.name);
}

TEST(DdsTransport, TellsWhichEndpointsAreTheNodes) {
  const auto transport = open(Distro::kJazzy, "walker");
  TopicWriter<rosgraph_msgs::Clock> clock(*transport, "/clock");
  TopicReader<geometry_msgs::Twist> command(*transport, "/cmd_vel");
  const rmw_dds_common::ParticipantEntitiesInfo told = told_by(*transport);
  ASSERT_EQ(told.node_entities_info_seq.size(), 1U);
  const rmw_dds_common::NodeEntitiesInfo& node = told.node_entities_info_seq[0];
  EXPECT_EQ(node.node_namespace, "/");
  EXPECT_EQ(node.node_name, "walker");
  const Onlooker onlooker;
  const auto guid_of = [&](dds_entity_t topic, const char* name) {
    rmw_dds_common::Gid gid;
    const dds_guid_t found = onlooker.guids(topic).at(name);
    std::copy(std::begin(found.v), std::end(found.v), gid.data.begin());
    return gid;
  };
  EXPECT_THAT(node.writer_gid_seq,
              testing::ElementsAre(guid_of(DDS_BUILTIN_TOPIC_DCPSPUBLICATION, "rt/clock")));
  EXPECT_THAT(node.reader_gid_seq,
              testing::ElementsAre(guid_of(DDS_BUILTIN_TOPIC_DCPSSUBSCRIPTION, "rt/cmd_vel")));
  // The participant's: the same but for the last four bytes.
  EXPECT_TRUE(std::equal(told.gid.data.begin(), told.gid.data.begin() + 12,
                         node.writer_gid_seq[0].data.begin()));
}

TEST(DiscoveryInfo, IdentifiersHave24BytesInHumbleAnd16Later) {
  internal::DiscoveryInfo info;
  info.participant = {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16};
  info.node = "a";
  info.writers = {info.participant};
  const std::vector<std::byte> jazzy = internal::encode(info, Distro::kJazzy);
  const std::vector<std::byte> humble = internal::encode(info, Distro::kHumble);
  EXPECT_EQ(humble.size(), jazzy.size() + 2 * 8);
  EXPECT_TRUE(std::equal(jazzy.begin(), jazzy.begin() + 20, humble.begin()));
  EXPECT_TRUE(std::all_of(humble.begin() + 20, humble.begin() + 28,
                          [](std::byte b) { return b == std::byte{0}; }));
  EXPECT_TRUE(
      std::equal(jazzy.begin() + 20, jazzy.end(), humble.begin() + 28, humble.end() - 8));
}

/// A reader in another process (dds_peer_program.cpp).
class OtherProcess {
 public:
  explicit OtherProcess(const std::string& last) {
    std::string words[] = {DDS_PEER, "listen", std::to_string(kDomain), last};
    char* arguments[] = {words[0].data(), words[1].data(), words[2].data(), words[3].data(),
                         nullptr};
    EXPECT_EQ(posix_spawn(&pid_, DDS_PEER, nullptr, nullptr, arguments, environ), 0);
  }
  ~OtherProcess() {
    if (pid_ > 0) {
      send(SIGKILL);
      (void)exit_code();
    }
  }
  OtherProcess(const OtherProcess&) = delete;
  OtherProcess& operator=(const OtherProcess&) = delete;

  void send(int signal) const { kill(pid_, signal); }
  /// Stands still from now on, and every packet waits.
  void stop() const {
    send(SIGSTOP);
    int status = 0;
    waitpid(pid_, &status, WUNTRACED);
    ASSERT_TRUE(WIFSTOPPED(status));
  }
  int exit_code() {
    int status = 0;
    waitpid(std::exchange(pid_, 0), &status, 0);
    return WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
  }

 private:
  pid_t pid_ = 0;
};

/// With writers of either implementation.
class SlowReader : public testing::TestWithParam<Implementation> {
 protected:
  void SetUp() override {
    if (!has_transport(GetParam())) GTEST_SKIP() << "built without it";
    transport_ = open(GetParam());
    writer_.emplace(*transport_, "/numbers", Qos{.depth = 5});
    const TopicReader<std_msgs::Bool> ready(*transport_, "/ready");
    ASSERT_TRUE(comes_true(*transport_,
                           [&] { return writer_->readers() == 1 && ready.writers() == 1; }));
  }
  /// Sends that many images of 1 MB. @return  How many were lost.
  int send(int count) {
    sensor_msgs::Image image;
    image.data.resize(1'000'000);
    int lost = 0;
    for (int k = 1; k <= count; ++k) {
      image.header.frame_id = std::to_string(k);
      lost += writer_->write(image) ? 0 : 1;
    }
    return lost;
  }

  std::unique_ptr<Transport> transport_;
  std::optional<TopicWriter<sensor_msgs::Image>> writer_;
  OtherProcess reader_{"100"};
};

INSTANTIATE_TEST_SUITE_P(, SlowReader,
                         testing::Values(Implementation::kCyclone, Implementation::kFast),
                         [](const auto& one) {
                           return one.param == Implementation::kFast ? "Fast" : "Cyclone";
                         });

// A writer that waited would give up at once here, because its patience is none.
TEST_P(SlowReader, HoldsNobodyUpAndGetsTheNewestLater) {
  reader_.stop();
  EXPECT_EQ(send(100), 0);
  // Fast DDS 2.9.1 holds nobody up, but brings a reader of Cyclone nothing any more after
  // that.
  if (GetParam() == Implementation::kFast) return;
  reader_.send(SIGCONT);
  EXPECT_EQ(reader_.exit_code(), 0);
}

TEST_P(SlowReader, ThatDiesHoldsNobodyUp) {
  reader_.send(SIGKILL);
  EXPECT_EQ(reader_.exit_code(), -SIGKILL);
  EXPECT_EQ(send(100), 0);
}

}  // namespace
}  // namespace segsim::ros::dds

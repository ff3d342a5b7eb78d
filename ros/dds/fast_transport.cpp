#include <algorithm>
#include <cstring>
#include <map>
#include <mutex>
#include <set>
#include <utility>

#include <fastdds/dds/core/condition/GuardCondition.hpp>
#include <fastdds/dds/core/condition/WaitSet.hpp>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/publisher/qos/DataWriterQos.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/subscriber/qos/DataReaderQos.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>

#include "core/error.h"
#include "ros/dds/internal/discovery_info.h"
#include "ros/dds/internal/implementations.h"
#include "ros/dds/transport.h"

namespace segsim::ros::dds {
namespace {

namespace fast = eprosima::fastdds::dds;
namespace rtps = eprosima::fastrtps::rtps;
using Bytes = std::vector<std::byte>;
using Code = eprosima::fastrtps::types::ReturnCode_t;
using core::InputError;
using internal::Guid;

/// Bytes that are XCDR1 already, with their encapsulation. It has no key.
class RawType final : public fast::TopicDataType {
 public:
  explicit RawType(const std::string& name) {
    setName(name.c_str());
    m_typeSize = 256;  // To begin with: payloads grow.
    m_isGetKeyDefined = false;
    auto_fill_type_object(false);
    auto_fill_type_information(false);
  }
  bool serialize(void* data, rtps::SerializedPayload_t* payload) override {
    const auto& cdr = *static_cast<const std::span<const std::byte>*>(data);
    if (cdr.size() > payload->max_size) return false;
    payload->encapsulation = CDR_LE;
    payload->length = static_cast<std::uint32_t>(cdr.size());
    std::memcpy(payload->data, cdr.data(), cdr.size());
    return true;
  }
  bool deserialize(rtps::SerializedPayload_t* payload, void* data) override {
    const auto* bytes = reinterpret_cast<const std::byte*>(payload->data);
    static_cast<Bytes*>(data)->assign(bytes, bytes + payload->length);
    return true;
  }
  std::function<std::uint32_t()> getSerializedSizeProvider(void* data) override {
    const auto& cdr = *static_cast<const std::span<const std::byte>*>(data);
    return [size = static_cast<std::uint32_t>(cdr.size())] { return size; };
  }
  void* createData() override { return new Bytes; }
  void deleteData(void* data) override { delete static_cast<Bytes*>(data); }
  bool getKey(void* /*data*/, rtps::InstanceHandle_t* /*key*/, bool /*md5*/) override {
    return false;
  }
};

std::vector<rtps::octet> octets(const std::string& text) { return {text.begin(), text.end()}; }

/// What is alike in the QoS of readers and writers.
template <class EndpointQos>
void set_qos(EndpointQos& qos, const Topic& topic) {
  qos.reliability().kind =
      topic.qos.reliable ? fast::RELIABLE_RELIABILITY_QOS : fast::BEST_EFFORT_RELIABILITY_QOS;
  qos.durability().kind = topic.qos.transient_local ? fast::TRANSIENT_LOCAL_DURABILITY_QOS
                                                    : fast::VOLATILE_DURABILITY_QOS;
  qos.history().kind = fast::KEEP_LAST_HISTORY_QOS;
  qos.history().depth = topic.qos.depth;
  qos.endpoint().history_memory_policy = rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
  qos.data_sharing().off();
  qos.user_data().setValue(octets(internal::endpoint_user_data(topic)));
}

Guid guid_of(const rtps::GUID_t& found) {
  Guid guid;
  std::copy_n(found.guidPrefix.value, 12, guid.begin());
  std::copy_n(found.entityId.value, 4, guid.begin() + 12);
  return guid;
}

/// The participant of a transport, with all that belongs to it.
class Participant {
 public:
  Participant(int domain, const std::string& config) {
    auto* factory = fast::DomainParticipantFactory::get_instance();
    fast::DomainParticipantQos qos = factory->get_default_participant_qos();
    const std::string place = "ROS 2, domain " + std::to_string(domain);
    if (!config.empty()) load_profile(config, place, qos);
    qos.user_data().setValue(octets(internal::kParticipantUserData));
    participant_ = factory->create_participant(static_cast<fast::DomainId_t>(domain), qos);
    if (participant_ == nullptr) {
      throw InputError(place + ": Fast DDS cannot join it");
    }
    publisher_ = participant_->create_publisher(fast::PUBLISHER_QOS_DEFAULT);
    subscriber_ = participant_->create_subscriber(fast::SUBSCRIBER_QOS_DEFAULT);
  }
  ~Participant() {
    if (participant_ == nullptr) return;
    participant_->delete_contained_entities();
    fast::DomainParticipantFactory::get_instance()->delete_participant(participant_);
  }
  Participant(const Participant&) = delete;
  Participant& operator=(const Participant&) = delete;

  fast::DomainParticipant* operator->() const { return participant_; }
  [[nodiscard]] fast::Publisher* publisher() const { return publisher_; }
  [[nodiscard]] fast::Subscriber* subscriber() const { return subscriber_; }

  /// One for all endpoints of its name, which must be of one type.
  fast::Topic* topic(const Topic& of) {
    fast::Topic*& topic = topics_[of.name];
    if (topic == nullptr) {
      fast::TypeSupport(new RawType(of.type_name)).register_type(participant_);
      topic = participant_->create_topic(of.name, of.type_name, fast::TOPIC_QOS_DEFAULT);
    }
    if (topic == nullptr || topic->get_type_name() != of.type_name) {
      throw InputError::expected("topic " + of.name, "one type in this participant", "two");
    }
    return topic;
  }

 private:
  /// The participant's profile "segsim" of XML, which the process keeps.
  static void load_profile(const std::string& xml, const std::string& place,
                           fast::DomainParticipantQos& qos) {
    static std::mutex mutex;
    static std::set<std::string> loaded;
    const std::lock_guard<std::mutex> lock(mutex);
    auto* factory = fast::DomainParticipantFactory::get_instance();
    if (!loaded.contains(xml) &&
        factory->load_XML_profiles_string(xml.c_str(), xml.size()) != Code::RETCODE_OK) {
      throw InputError::expected(place, "XML profiles of Fast DDS as configuration",
                                 "something else");
    }
    loaded.insert(xml);
    if (factory->get_participant_qos_from_profile("segsim", qos) != Code::RETCODE_OK) {
      throw InputError::expected(place, "a participant profile \"segsim\" in the XML", "none");
    }
  }

  fast::DomainParticipant* participant_ = nullptr;
  fast::Publisher* publisher_ = nullptr;
  fast::Subscriber* subscriber_ = nullptr;
  std::map<std::string, fast::Topic*> topics_;
};

class FastWriter final : public Writer {
 public:
  FastWriter(Participant& participant, const Topic& topic) : participant_(participant) {
    fast::DataWriterQos qos = participant.publisher()->get_default_datawriter_qos();
    set_qos(qos, topic);
    // Images are sent in parts, which synchronous writers cannot.
    qos.publish_mode().kind = fast::ASYNCHRONOUS_PUBLISH_MODE;
    qos.writer_data_lifecycle().autodispose_unregistered_instances = false;
    writer_ = participant.publisher()->create_datawriter(participant.topic(topic), qos);
    if (writer_ == nullptr) throw InputError("topic " + topic.name + ": Fast DDS refuses it");
  }
  ~FastWriter() override { participant_.publisher()->delete_datawriter(writer_); }
  FastWriter(const FastWriter&) = delete;
  FastWriter& operator=(const FastWriter&) = delete;

  bool write(std::span<const std::byte> cdr) override { return writer_->write(&cdr); }
  [[nodiscard]] int readers() const override {
    fast::PublicationMatchedStatus status;
    writer_->get_publication_matched_status(status);
    return status.current_count;
  }
  [[nodiscard]] Guid guid() const { return guid_of(writer_->guid()); }

 private:
  Participant& participant_;
  fast::DataWriter* writer_;
};

/// Readers that a transport waits for.
struct Listening {
  fast::WaitSet waits;
  std::vector<fast::DataReader*> readers;
};

class FastReader final : public Reader {
 public:
  FastReader(Participant& participant, const Topic& topic, Listening& listening)
      : participant_(participant), listening_(listening) {
    fast::DataReaderQos qos = participant.subscriber()->get_default_datareader_qos();
    set_qos(qos, topic);
    reader_ = participant.subscriber()->create_datareader(participant.topic(topic), qos);
    if (reader_ == nullptr) throw InputError("topic " + topic.name + ": Fast DDS refuses it");
    reader_->get_statuscondition().set_enabled_statuses(fast::StatusMask::data_available());
    listening_.waits.attach_condition(reader_->get_statuscondition());
    listening_.readers.push_back(reader_);
  }
  ~FastReader() override {
    listening_.waits.detach_condition(reader_->get_statuscondition());
    std::erase(listening_.readers, reader_);
    participant_.subscriber()->delete_datareader(reader_);
  }
  FastReader(const FastReader&) = delete;
  FastReader& operator=(const FastReader&) = delete;

  bool take(std::vector<std::byte>& cdr) override {
    fast::SampleInfo info;
    while (reader_->take_next_sample(&cdr, &info) == Code::RETCODE_OK) {
      if (info.valid_data) return true;  // Else a writer went away.
    }
    return false;
  }
  [[nodiscard]] int writers() const override {
    fast::SubscriptionMatchedStatus status;
    reader_->get_subscription_matched_status(status);
    return status.current_count;
  }
  [[nodiscard]] Guid guid() const { return guid_of(reader_->guid()); }

 private:
  Participant& participant_;
  Listening& listening_;
  fast::DataReader* reader_;
};

class FastTransport final : public Transport {
 public:
  explicit FastTransport(const TransportOptions& options)
      : distro_(options.distro), participant_(options.domain, options.config) {
    listening_.waits.attach_condition(never_);
    info_.participant = guid_of(participant_->guid());
    info_.node = options.node;
    discovery_ =
        std::make_unique<FastWriter>(participant_, internal::discovery_topic(distro_));
    tell();
  }

  std::unique_ptr<Writer> make_writer(const Topic& topic) override {
    auto writer =
        std::make_unique<FastWriter>(participant_, internal::on_wire(topic, distro_));
    info_.writers.push_back(writer->guid());
    tell();
    return writer;
  }

  std::unique_ptr<Reader> make_reader(const Topic& topic) override {
    auto reader = std::make_unique<FastReader>(participant_, internal::on_wire(topic, distro_),
                                               listening_);
    info_.readers.push_back(reader->guid());
    tell();
    return reader;
  }

  bool wait(double timeout_s) override {
    if (has_message()) return true;
    fast::ConditionSeq active;
    const auto seconds = static_cast<std::int32_t>(timeout_s);
    const auto rest_ns = static_cast<std::uint32_t>((timeout_s - seconds) * 1e9);
    listening_.waits.wait(active, eprosima::fastrtps::Duration_t(seconds, rest_ns));
    return has_message();
  }

 private:
  [[nodiscard]] bool has_message() const {
    return std::any_of(listening_.readers.begin(), listening_.readers.end(),
                       [](const fast::DataReader* r) { return r->get_unread_count() > 0; });
  }
  void tell() { (void)discovery_->write(internal::encode(info_, distro_)); }

  Distro distro_;
  Participant participant_;
  fast::GuardCondition never_;
  Listening listening_;
  internal::DiscoveryInfo info_;
  std::unique_ptr<FastWriter> discovery_;
};

}  // namespace

namespace internal {

std::unique_ptr<Transport> open_fast(const TransportOptions& options) {
  return std::make_unique<FastTransport>(options);
}

bool has_fast() { return true; }

}  // namespace internal

}  // namespace segsim::ros::dds

#include <cstdlib>
#include <cstring>
#include <map>
#include <mutex>
#include <utility>

#include <dds/dds.h>
#include <dds/ddsi/ddsi_serdata.h>
#include <dds/ddsi/ddsi_sertype.h>

#include "core/error.h"
#include "ros/dds/internal/discovery_info.h"
#include "ros/dds/internal/implementations.h"
#include "ros/dds/internal/raw_type.h"
#include "ros/dds/transport.h"

namespace segsim::ros::dds {
namespace {

using core::InputError;
using internal::Guid;

/// Images in large packets: in those of 1.3 kB, which are Cyclone's default, a burst overflows
/// the 208 kB that Linux gives a socket by default, and waits to be sent again. Of 30 RGB-D
/// images a second, 640 x 480, a busy machine lost 2 to 30 % so, and none in packets of 65 kB
/// (tests/experiments/ros2/ros2_bench.cpp).
constexpr const char* kOwnConfig =
    "<General><MaxMessageSize>65500B</MaxMessageSize>"
    "<FragmentSize>65000B</FragmentSize></General>";

/// Throws what went wrong if an answer of Cyclone is negative.
template <class Answer>
Answer checked(Answer answer, const std::string& what) {
  if (answer < 0) {
    throw InputError(
        what + ": Cyclone DDS says: " + dds_strretcode(static_cast<dds_return_t>(-answer)));
  }
  return answer;
}

/// Deletes an entity, and all that belongs to it.
class Entity {
 public:
  Entity() = default;
  explicit Entity(dds_entity_t handle) : handle_(handle) {}
  Entity(Entity&& other) noexcept : handle_(std::exchange(other.handle_, 0)) {}
  Entity& operator=(Entity&& other) noexcept {
    std::swap(handle_, other.handle_);
    return *this;
  }
  Entity(const Entity&) = delete;
  Entity& operator=(const Entity&) = delete;
  ~Entity() {
    if (handle_ > 0) dds_delete(handle_);
  }
  [[nodiscard]] dds_entity_t get() const { return handle_; }

 private:
  dds_entity_t handle_ = 0;
};

/// The domains of this process, each as long as somebody is in it.
std::shared_ptr<Entity> join_domain(int domain, const std::string& config) {
  static std::mutex mutex;
  static std::map<int, std::weak_ptr<Entity>> domains;
  const std::lock_guard<std::mutex> lock(mutex);
  if (auto joined = domains[domain].lock()) return joined;
  const char* environment = std::getenv("CYCLONEDDS_URI");
  std::string all = kOwnConfig;
  for (const std::string& more :
       {std::string(environment != nullptr ? environment : ""), config}) {
    if (!more.empty()) all += "," + more;
  }
  const std::string place = "ROS 2, domain " + std::to_string(domain);
  auto made = std::make_shared<Entity>(
      checked(dds_create_domain(static_cast<dds_domainid_t>(domain), all.c_str()), place));
  domains[domain] = made;
  return made;
}

using QosPointer = std::unique_ptr<dds_qos_t, decltype(&dds_delete_qos)>;

QosPointer make_qos(const Qos& wanted) {
  QosPointer qos(dds_create_qos(), dds_delete_qos);
  // A history of the newest messages drops the oldest instead of making its writer wait.
  dds_qset_reliability(
      qos.get(), wanted.reliable ? DDS_RELIABILITY_RELIABLE : DDS_RELIABILITY_BEST_EFFORT, 0);
  dds_qset_history(qos.get(), DDS_HISTORY_KEEP_LAST, wanted.depth);
  dds_qset_durability(qos.get(), wanted.transient_local ? DDS_DURABILITY_TRANSIENT_LOCAL
                                                        : DDS_DURABILITY_VOLATILE);
  if (wanted.transient_local) {
    dds_qset_durability_service(qos.get(), 0, DDS_HISTORY_KEEP_LAST, wanted.depth,
                                DDS_LENGTH_UNLIMITED, DDS_LENGTH_UNLIMITED,
                                DDS_LENGTH_UNLIMITED);
  }
  dds_qset_writer_data_lifecycle(qos.get(), false);
  const dds_data_representation_id_t representation = DDS_DATA_REPRESENTATION_XCDR1;
  dds_qset_data_representation(qos.get(), 1, &representation);
  return qos;
}

void set_user_data(dds_qos_t* qos, const std::string& text) {
  if (!text.empty()) dds_qset_userdata(qos, text.data(), text.size());
}

Guid guid_of(dds_entity_t entity) {
  dds_guid_t found;
  checked(dds_get_guid(entity, &found), "GUID");
  Guid guid;
  static_assert(sizeof found.v == sizeof(Guid));
  std::memcpy(guid.data(), found.v, sizeof found.v);
  return guid;
}

class CycloneWriter final : public Writer {
 public:
  CycloneWriter(Entity topic, Entity writer, const ddsi_sertype* type)
      : topic_(std::move(topic)), writer_(std::move(writer)), type_(type) {}

  bool write(std::span<const std::byte> cdr) override {
    return dds_writecdr(writer_.get(), internal::make_raw_sample(type_, cdr)) ==
           DDS_RETCODE_OK;
  }
  [[nodiscard]] int readers() const override {
    dds_publication_matched_status_t status;
    checked(dds_get_publication_matched_status(writer_.get(), &status), "readers");
    return static_cast<int>(status.current_count);
  }

 private:
  Entity topic_, writer_;
  const ddsi_sertype* type_;  ///< The topic's.
};

class CycloneReader final : public Reader {
 public:
  CycloneReader(Entity topic, Entity reader, dds_entity_t waitset)
      : topic_(std::move(topic)), reader_(std::move(reader)), waitset_(waitset) {
    condition_ = Entity(
        checked(dds_create_readcondition(reader_.get(), DDS_ANY_STATE), "read condition"));
    checked(dds_waitset_attach(waitset_, condition_.get(), 0), "wait set");
  }
  ~CycloneReader() override { dds_waitset_detach(waitset_, condition_.get()); }
  CycloneReader(const CycloneReader&) = delete;
  CycloneReader& operator=(const CycloneReader&) = delete;

  bool take(std::vector<std::byte>& cdr) override {
    for (;;) {
      ddsi_serdata* sample = nullptr;
      dds_sample_info_t info;
      const auto count =
          checked(dds_takecdr(reader_.get(), &sample, 1, &info, DDS_ANY_STATE), "take");
      if (count == 0) return false;
      const std::unique_ptr<ddsi_serdata, void (*)(ddsi_serdata*)> owner(sample,
                                                                         ddsi_serdata_unref);
      if (!info.valid_data) continue;  // A writer went away.
      internal::copy_raw_sample(sample, cdr);
      return true;
    }
  }
  [[nodiscard]] int writers() const override {
    dds_subscription_matched_status_t status;
    checked(dds_get_subscription_matched_status(reader_.get(), &status), "writers");
    return static_cast<int>(status.current_count);
  }

 private:
  Entity topic_, reader_, condition_;
  dds_entity_t waitset_;
};

class CycloneTransport final : public Transport {
 public:
  explicit CycloneTransport(const TransportOptions& options)
      : distro_(options.distro), domain_(join_domain(options.domain, options.config)) {
    QosPointer qos(dds_create_qos(), dds_delete_qos);
    set_user_data(qos.get(), internal::kParticipantUserData);
    participant_ =
        Entity(checked(dds_create_participant(static_cast<dds_domainid_t>(options.domain),
                                              qos.get(), nullptr),
                       "ROS 2, domain " + std::to_string(options.domain)));
    waitset_ = Entity(checked(dds_create_waitset(participant_.get()), "wait set"));
    // A wait set without anything in it does not wait.
    never_ = Entity(checked(dds_create_guardcondition(participant_.get()), "condition"));
    checked(dds_waitset_attach(waitset_.get(), never_.get(), 0), "wait set");
    info_.participant = guid_of(participant_.get());
    info_.node = options.node;
    discovery_ = make_bare_writer(internal::discovery_topic(distro_)).first;
    tell();
  }

  std::unique_ptr<Writer> make_writer(const Topic& topic) override {
    auto [writer, guid] = make_bare_writer(internal::on_wire(topic, distro_));
    info_.writers.push_back(guid);
    tell();
    return std::move(writer);
  }

  std::unique_ptr<Reader> make_reader(const Topic& of_ros) override {
    const Topic topic = internal::on_wire(of_ros, distro_);
    auto [entity, type] = make_topic(topic);
    const QosPointer qos = endpoint_qos(topic);
    Entity reader(checked(
        dds_create_reader(participant_.get(), entity.get(), qos.get(), nullptr), topic.name));
    info_.readers.push_back(guid_of(reader.get()));
    tell();
    return std::make_unique<CycloneReader>(std::move(entity), std::move(reader),
                                           waitset_.get());
  }

  bool wait(double timeout_s) override {
    dds_attach_t which = 0;
    const auto timeout = static_cast<dds_duration_t>(timeout_s * 1e9);
    return checked(dds_waitset_wait(waitset_.get(), &which, 1, timeout), "wait") > 0;
  }

 private:
  std::pair<Entity, const ddsi_sertype*> make_topic(const Topic& topic) {
    ddsi_sertype* type = internal::make_raw_type(topic.type_name);
    const dds_entity_t made = dds_create_topic_sertype(participant_.get(), topic.name.c_str(),
                                                       &type, nullptr, nullptr, nullptr);
    if (made < 0) ddsi_sertype_unref(type);
    return {Entity(checked(made, topic.name)), type};
  }

  static QosPointer endpoint_qos(const Topic& topic) {
    QosPointer qos = make_qos(topic.qos);
    set_user_data(qos.get(), internal::endpoint_user_data(topic));
    return qos;
  }

  std::pair<std::unique_ptr<Writer>, Guid> make_bare_writer(const Topic& topic) {
    auto [entity, type] = make_topic(topic);
    const QosPointer qos = endpoint_qos(topic);
    Entity writer(checked(
        dds_create_writer(participant_.get(), entity.get(), qos.get(), nullptr), topic.name));
    const Guid guid = guid_of(writer.get());
    return {std::make_unique<CycloneWriter>(std::move(entity), std::move(writer), type), guid};
  }

  void tell() { (void)discovery_->write(internal::encode(info_, distro_)); }

  Distro distro_;
  std::shared_ptr<Entity> domain_;
  Entity participant_, waitset_, never_;
  internal::DiscoveryInfo info_;
  std::unique_ptr<Writer> discovery_;
};

}  // namespace

namespace internal {

std::unique_ptr<Transport> open_cyclone(const TransportOptions& options) {
  return std::make_unique<CycloneTransport>(options);
}

bool has_cyclone() { return true; }

}  // namespace internal

}  // namespace segsim::ros::dds

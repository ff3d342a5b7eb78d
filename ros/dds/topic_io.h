#pragma once

/// @file
/// Messages of known types on topics.

#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "ros/cdr.h"
#include "ros/dds/transport.h"

namespace segsim::ros::dds {

template <Message M>
class TopicWriter {
 public:
  /// @param transport  Must outlive it.
  TopicWriter(Transport& transport, const std::string& topic, const Qos& qos = {})
      : writer_(transport.make_writer(topic_of<M>(topic, qos))) {}

  bool write(const M& message) {
    encode_cdr(message, bytes_);
    return writer_->write(bytes_);
  }
  [[nodiscard]] int readers() const { return writer_->readers(); }

 private:
  std::unique_ptr<Writer> writer_;
  std::vector<std::byte> bytes_;
};

template <Message M>
class TopicReader {
 public:
  /// @param transport  Must outlive it.
  TopicReader(Transport& transport, const std::string& topic, const Qos& qos = {})
      : topic_(topic), reader_(transport.make_reader(topic_of<M>(topic, qos))) {}

  /// The oldest message that was not taken yet.
  /// @throws core::InputError if the bytes are no `M`.
  [[nodiscard]] std::optional<M> take() {
    if (!reader_->take(bytes_)) return std::nullopt;
    return decode_cdr<M>(bytes_, topic_);
  }
  [[nodiscard]] int writers() const { return reader_->writers(); }
  [[nodiscard]] const std::string& topic() const { return topic_; }

 private:
  std::string topic_;
  std::unique_ptr<Reader> reader_;
  std::vector<std::byte> bytes_;
};

}  // namespace segsim::ros::dds

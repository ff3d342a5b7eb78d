#include "ros/dds/internal/raw_type.h"

#include <algorithm>
#include <cstring>
#include <memory>

#include <dds/ddsi/ddsi_keyhash.h>
#include <dds/ddsi/ddsi_serdata.h>
#include <dds/ddsi/ddsi_sertype.h>
#include <dds/ddsi/q_radmin.h>

#include "core/check.h"

namespace segsim::ros::dds::internal {
namespace {

/// Cyclone frees and compares these by the functions below; it knows the base alone.
struct RawSample : ddsi_serdata {
  RawSample(const ddsi_sertype* of, ddsi_serdata_kind what) : ddsi_serdata() {
    ddsi_serdata_init(this, of, what);
    hash = of->serdata_basehash;  // One instance: there is no key.
  }
  /// Of whole words, as the protocol sends them.
  void resize(std::size_t new_size) {
    size = new_size;
    bytes.resize((new_size + 3) / 4 * 4);
  }
  std::size_t size = 0;
  std::vector<std::byte> bytes;
};

RawSample* raw(ddsi_serdata* sample) { return static_cast<RawSample*>(sample); }
const RawSample* raw(const ddsi_serdata* sample) {
  return static_cast<const RawSample*>(sample);
}

bool equal_keys(const ddsi_serdata* /*a*/, const ddsi_serdata* /*b*/) { return true; }

std::uint32_t size_of(const ddsi_serdata* sample) {
  return static_cast<std::uint32_t>(raw(sample)->size);
}

ddsi_serdata* from_network(const ddsi_sertype* type, ddsi_serdata_kind kind,
                           const nn_rdata* fragment, std::size_t size) {
  auto sample = std::make_unique<RawSample>(type, kind);
  sample->resize(size);
  std::uint32_t done = 0;
  // Fragments ascend and may overlap.
  for (; fragment != nullptr; fragment = fragment->nextfrag) {
    if (fragment->maxp1 <= done) continue;
    const unsigned char* payload =
        NN_RMSG_PAYLOADOFF(fragment->rmsg, NN_RDATA_PAYLOAD_OFF(fragment));
    const std::uint32_t end = std::min(fragment->maxp1, static_cast<std::uint32_t>(size));
    if (fragment->min > done || end <= done) return nullptr;
    std::memcpy(sample->bytes.data() + done, payload + (done - fragment->min), end - done);
    done = end;
  }
  return done == size ? sample.release() : nullptr;
}

ddsi_serdata* from_parts(const ddsi_sertype* type, ddsi_serdata_kind kind,
                         ddsrt_msg_iovlen_t count, const ddsrt_iovec_t* parts,
                         std::size_t size) {
  auto sample = std::make_unique<RawSample>(type, kind);
  sample->resize(size);
  std::size_t done = 0;
  for (ddsrt_msg_iovlen_t k = 0; k < count && done < size; ++k) {
    const std::size_t part = std::min<std::size_t>(parts[k].iov_len, size - done);
    std::memcpy(sample->bytes.data() + done, parts[k].iov_base, part);
    done += part;
  }
  return sample.release();
}

ddsi_serdata* from_key(const ddsi_sertype* type, const ddsi_keyhash* /*key*/) {
  return new RawSample(type, SDK_KEY);
}

ddsi_serdata* from_struct(const ddsi_sertype* /*type*/, ddsi_serdata_kind /*kind*/,
                          const void* /*sample*/) {
  return nullptr;  // There are no structs of this type.
}

void to_network(const ddsi_serdata* sample, std::size_t offset, std::size_t size, void* to) {
  std::memcpy(to, raw(sample)->bytes.data() + offset, size);
}

ddsi_serdata* lend_to_network(const ddsi_serdata* sample, std::size_t offset, std::size_t size,
                              ddsrt_iovec_t* to) {
  to->iov_base = const_cast<std::byte*>(raw(sample)->bytes.data() + offset);
  to->iov_len = size;
  return ddsi_serdata_ref(sample);
}

void take_back(ddsi_serdata* sample, const ddsrt_iovec_t* /*lent*/) {
  ddsi_serdata_unref(sample);
}

bool to_struct(const ddsi_serdata* /*sample*/, void* /*to*/, void** /*buffer*/,
               void* /*limit*/) {
  return false;
}

ddsi_serdata* without_type(const ddsi_serdata* sample) {
  auto* key = new RawSample(sample->type, SDK_KEY);
  key->type = nullptr;
  return key;
}

bool key_to_struct(const ddsi_sertype* /*type*/, const ddsi_serdata* /*key*/, void* /*to*/,
                   void** /*buffer*/, void* /*limit*/) {
  return true;  // Nothing to fill in.
}

void free_sample(ddsi_serdata* sample) { delete raw(sample); }

std::size_t print_sample(const ddsi_sertype* /*type*/, const ddsi_serdata* sample, char* to,
                         std::size_t size) {
  return static_cast<std::size_t>(std::snprintf(to, size, "%zu bytes", raw(sample)->size));
}

void key_hash(const ddsi_serdata* /*sample*/, ddsi_keyhash* to, bool /*md5*/) {
  std::memset(to, 0, sizeof *to);
}

const ddsi_serdata_ops& sample_functions() {
  static const ddsi_serdata_ops functions = [] {
    ddsi_serdata_ops ops{};
    ops.eqkey = equal_keys;
    ops.get_size = size_of;
    ops.from_ser = from_network;
    ops.from_ser_iov = from_parts;
    ops.from_keyhash = from_key;
    ops.from_sample = from_struct;
    ops.to_ser = to_network;
    ops.to_ser_ref = lend_to_network;
    ops.to_ser_unref = take_back;
    ops.to_sample = to_struct;
    ops.to_untyped = without_type;
    ops.untyped_to_sample = key_to_struct;
    ops.free = free_sample;
    ops.print = print_sample;
    ops.get_keyhash = key_hash;
    return ops;
  }();
  return functions;
}

void free_type(ddsi_sertype* type) {
  ddsi_sertype_fini(type);
  delete type;
}

void no_samples(const ddsi_sertype* /*type*/, void* /*samples*/, std::size_t /*count*/) {}

void no_memory(void** pointers, const ddsi_sertype* /*type*/, void* /*old*/,
               std::size_t /*old_count*/, std::size_t count) {
  std::fill_n(pointers, count, nullptr);
}

void nothing_to_free(const ddsi_sertype* /*type*/, void** /*pointers*/, std::size_t /*count*/,
                     dds_free_op_t /*what*/) {}

/// Their names are equal, and nothing else distinguishes them.
bool equal_types(const ddsi_sertype* /*a*/, const ddsi_sertype* /*b*/) { return true; }
std::uint32_t hash_of_type(const ddsi_sertype* /*type*/) { return 0; }

const ddsi_sertype_ops& type_functions() {
  static const ddsi_sertype_ops functions = [] {
    ddsi_sertype_ops ops{};
    ops.version = ddsi_sertype_v0;
    ops.free = free_type;
    ops.zero_samples = no_samples;
    ops.realloc_samples = no_memory;
    ops.free_samples = nothing_to_free;
    ops.equal = equal_types;
    ops.hash = hash_of_type;
    return ops;
  }();
  return functions;
}

}  // namespace

ddsi_sertype* make_raw_type(const std::string& type_name) {
  auto* type = new ddsi_sertype();
  ddsi_sertype_init_flags(type, type_name.c_str(), &type_functions(), &sample_functions(),
                          DDSI_SERTYPE_FLAG_TOPICKIND_NO_KEY);
  type->allowed_data_representation = DDS_DATA_REPRESENTATION_FLAG_XCDR1;
  return type;
}

ddsi_serdata* make_raw_sample(const ddsi_sertype* type, std::span<const std::byte> cdr) {
  SEGSIM_CHECK(cdr.size() >= 4, "the encapsulation has four bytes");
  auto* sample = new RawSample(type, SDK_DATA);
  sample->resize(cdr.size());
  std::memcpy(sample->bytes.data(), cdr.data(), cdr.size());
  return sample;
}

void copy_raw_sample(const ddsi_serdata* sample, std::vector<std::byte>& cdr) {
  const RawSample& received = *raw(sample);
  cdr.assign(received.bytes.begin(),
             received.bytes.begin() + static_cast<std::ptrdiff_t>(received.size));
}

}  // namespace segsim::ros::dds::internal

#include "renderer/raster/label_vote.h"

#include <algorithm>
#include <cstddef>
#include <vector>

#include "renderer/raster/selection_key.h"
#include "renderer/scene/render_options.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "renderer/raster/label_vote.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#ifndef SEGSIM_RENDERER_LABEL_VOTE_ONCE
#define SEGSIM_RENDERER_LABEL_VOTE_ONCE
namespace segsim::renderer::internal {
namespace {

/// SurfelShade as an array of 32-bit words.
constexpr int kShadeWords = static_cast<int>(sizeof(SurfelShade) / 4);
constexpr std::size_t kLabelWord = offsetof(SurfelShade, label) / 4;
static_assert(sizeof(SurfelShade) % 4 == 0 && offsetof(SurfelShade, label) % 4 == 0);

}  // namespace
}  // namespace segsim::renderer::internal
#endif  // SEGSIM_RENDERER_LABEL_VOTE_ONCE

HWY_BEFORE_NAMESPACE();
namespace segsim::renderer::internal {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using Floats = hn::CappedTag<float, 16>;
using Ints = hn::RebindToSigned<Floats>;
using Keys = hn::RebindToUnsigned<Floats>;
using V = hn::Vec<Floats>;
using I = hn::Vec<Ints>;

/// No id: larger than all others, so that it never wins a tie.
constexpr std::int32_t kNoId = 0x7FFFFFFF;

/// Selected surfels of a vector of pixels; weight 0 and label kNoId where there are fewer.
struct Candidates {
  V weight[kMaxTopK];
  I label[kMaxTopK];
  int count = 0;  ///< Of the pixel with the most.
  V total;
  bool unanimous = true;
  std::uint64_t read = 0;
};

HWY_INLINE void gather(const KeyRow& keys, std::size_t pixel, const std::uint32_t* slots,
                       const SurfelShade* shade, Candidates& out) {
  const Floats d;
  const Ints di;
  const Keys dk;
  const auto* slot_words = reinterpret_cast<const std::int32_t*>(slots);
  const auto* label_words = reinterpret_cast<const std::int32_t*>(shade) + kLabelWord;
  out.total = hn::Zero(d);
  for (int k = 0; k < keys.key_count; ++k) {
    const auto key =
        hn::LoadU(dk, keys.first + static_cast<std::size_t>(k) * keys.rank_stride + pixel);
    const auto there = hn::Gt(key, hn::Set(dk, kKeyPositionMask));
    if (hn::AllFalse(dk, there)) break;
    // Lanes without a key read the first position: some lane has one, so the list has it.
    const I position = hn::BitCast(
        di, hn::IfThenElseZero(there, hn::AndNot(key, hn::Set(dk, kKeyPositionMask))));
    const I slot = hn::GatherIndex(di, slot_words, position);
    const I label = hn::GatherIndex(di, label_words, hn::Mul(slot, hn::Set(di, kShadeWords)));
    const auto there_i = hn::RebindMask(di, there);
    const I id = hn::IfThenElse(there_i, label, hn::Set(di, kNoId));
    const auto bits =
        hn::Or(hn::ShiftRight<kKeyShift>(hn::And(key, hn::Set(dk, kKeyWeightMask))),
               hn::Set(dk, kKeyExponent | kKeyHalf));
    const V weight = hn::BitCast(d, hn::IfThenElseZero(there, bits));
    out.unanimous &= hn::AllTrue(
        di, hn::Or(hn::Not(there_i), k == 0 ? hn::Eq(id, id) : hn::Eq(id, out.label[0])));
    out.weight[k] = weight;
    out.label[k] = id;
    out.total = hn::Add(out.total, weight);
    out.read += hn::CountTrue(dk, there);
    out.count = k + 1;
  }
}

/// Heaviest value of 16 bits of the labels; the same order of additions as vote().
template <int kShift>
HWY_INLINE void heaviest(const Candidates& candidates, I& best_id, V& best_weight) {
  const Floats d;
  const Ints di;
  const I none = hn::Set(di, kNoId);
  I ids[kMaxTopK];
  for (int k = 0; k < candidates.count; ++k) {
    const I label = candidates.label[k];
    const I id = hn::And(hn::ShiftRight<kShift>(label), hn::Set(di, 0xFFFF));
    // A real label can equal kNoId, but not with weight 0.
    const auto there = hn::RebindMask(di, hn::Gt(candidates.weight[k], hn::Zero(d)));
    ids[k] = hn::IfThenElse(there, id, none);
  }
  best_id = hn::Zero(di);
  best_weight = hn::Zero(d);
  for (int i = 0; i < candidates.count; ++i) {
    V sum = hn::Zero(d);
    for (int j = 0; j < candidates.count; ++j) {
      const auto same = hn::RebindMask(d, hn::Eq(ids[j], ids[i]));
      sum = hn::Add(sum, hn::IfThenElseZero(same, candidates.weight[j]));
    }
    const auto lower = hn::RebindMask(d, hn::Lt(ids[i], best_id));
    const auto better =
        hn::Or(hn::Gt(sum, best_weight), hn::And(hn::Eq(sum, best_weight), lower));
    best_id = hn::IfThenElse(hn::RebindMask(di, better), ids[i], best_id);
    best_weight = hn::IfThenElse(better, sum, best_weight);
  }
}

HWY_INLINE void write(I semantic, I instance, V share, V instance_share, std::size_t pixel,
                      const LabelPlanes& out) {
  const Floats d;
  const hn::Rebind<std::uint16_t, Floats> d16;
  hn::StoreU(hn::DemoteTo(d16, semantic), d16, out.semantic + pixel);
  hn::StoreU(hn::DemoteTo(d16, instance), d16, out.instance + pixel);
  hn::StoreU(share, d, out.confidence + pixel);
  hn::StoreU(instance_share, d, out.instance_confidence + pixel);
}

std::uint64_t vote_row_simd(const KeyRow& keys, const std::uint32_t* slots,
                            const SurfelShade* shade, const LabelPlanes& out) {
  const Floats d;
  const Ints di;
  const std::size_t lanes = hn::Lanes(d);
  const auto count = static_cast<std::size_t>(keys.pixel_count);
  std::uint64_t read = 0;
  for (std::size_t pixel = 0; pixel < count; pixel += lanes) {
    Candidates candidates;
    gather(keys, pixel, slots, shade, candidates);
    read += candidates.read;
    if (candidates.count == 0) {
      write(hn::Zero(di), hn::Zero(di), hn::Zero(d), hn::Zero(d), pixel, out);
      continue;
    }
    const auto there = hn::Gt(candidates.total, hn::Zero(d));
    const auto there_i = hn::RebindMask(di, there);
    I semantic, instance;
    V share = hn::IfThenElseZero(there, hn::Set(d, 1.0F)), instance_share = share;
    if (candidates.unanimous) {  // Most are.
      const I label = hn::IfThenElseZero(there_i, candidates.label[0]);
      semantic = hn::And(label, hn::Set(di, 0xFFFF));
      instance = hn::And(hn::ShiftRight<16>(label), hn::Set(di, 0xFFFF));
    } else {
      heaviest<0>(candidates, semantic, share);
      heaviest<16>(candidates, instance, instance_share);
      const V total = hn::IfThenElse(there, candidates.total, hn::Set(d, 1.0F));
      share = hn::Div(share, total);
      instance_share = hn::Div(instance_share, total);
    }
    write(semantic, instance, share, instance_share, pixel, out);
  }
  return read;
}

}  // namespace HWY_NAMESPACE
}  // namespace segsim::renderer::internal
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace segsim::renderer::internal {
namespace {

HWY_EXPORT(vote_row_simd);

struct Winner {
  std::uint16_t id = 0;
  float weight = 0.0F;
};

/// Heaviest value of 16 bits of the labels, from bit `shift` on.
Winner heaviest_of_few(std::span<const WeightedLabel> candidates, unsigned shift) {
  const auto id_of = [&](const WeightedLabel& c) {
    return static_cast<std::uint16_t>(c.label >> shift);
  };
  Winner best;
  for (const WeightedLabel& c : candidates) {
    const std::uint16_t id = id_of(c);
    float sum = 0.0F;
    for (const WeightedLabel& other : candidates) {
      sum += id_of(other) == id ? other.weight : 0.0F;
    }
    if (sum > best.weight || (sum == best.weight && id < best.id)) best = {id, sum};
  }
  return best;
}

/// The same for the many surfels of a pixel that keeps all: sums in double precision.
Winner heaviest_of_many(std::span<const WeightedLabel> candidates, unsigned shift) {
  struct Sum {
    std::uint16_t id;
    double weight;
  };
  thread_local std::vector<Sum> sums;
  sums.clear();
  for (const WeightedLabel& c : candidates) {
    const auto id = static_cast<std::uint16_t>(c.label >> shift);
    const auto known =
        std::find_if(sums.begin(), sums.end(), [id](const Sum& s) { return s.id == id; });
    if (known == sums.end()) {
      sums.push_back({id, static_cast<double>(c.weight)});
    } else {
      known->weight += static_cast<double>(c.weight);
    }
  }
  const Sum& best =
      *std::max_element(sums.begin(), sums.end(), [](const Sum& a, const Sum& b) {
        return a.weight < b.weight || (a.weight == b.weight && a.id > b.id);
      });
  return {best.id, static_cast<float>(best.weight)};
}

}  // namespace

PixelLabel vote(std::span<const WeightedLabel> candidates) {
  if (candidates.empty()) return {};
  float total = 0.0F;
  bool unanimous = true;
  double precise_total = 0.0;
  for (const WeightedLabel& c : candidates) {
    total += c.weight;
    precise_total += static_cast<double>(c.weight);
    unanimous &= c.label == candidates.front().label;
  }
  if (unanimous) {
    const std::uint32_t label = candidates.front().label;
    return {static_cast<std::uint16_t>(label), static_cast<std::uint16_t>(label >> 16U), 1.0F,
            1.0F};
  }
  const bool few = candidates.size() <= static_cast<std::size_t>(kMaxTopK);
  const auto heaviest = few ? heaviest_of_few : heaviest_of_many;
  if (!few) total = static_cast<float>(precise_total);
  const Winner semantic = heaviest(candidates, 0);
  const Winner instance = heaviest(candidates, 16);
  return {semantic.id, instance.id, semantic.weight / total, instance.weight / total};
}

std::uint64_t vote_row(const KeyRow& keys, const std::uint32_t* slots,
                       const SurfelShade* shade, const LabelPlanes& out) {
  return HWY_DYNAMIC_DISPATCH(vote_row_simd)(keys, slots, shade, out);
}

}  // namespace segsim::renderer::internal
#endif  // HWY_ONCE

#pragma once

/// @file
/// YOLOv13 once more, in scalars and double precision, one image, written from the equations:
/// the oracle of the network's tests. Layers are looked up by their names in the state dict.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <string>
#include <vector>

#include "perception/checkpoint/weights_file.h"
#include "perception/checkpoint/yolov13_scale.h"

namespace segsim::perception::yolov13 {

struct Map {
  int channels = 0, height = 0, width = 0;
  std::vector<double> values;

  Map(int c, int h, int w)
      : channels(c),
        height(h),
        width(w),
        values(static_cast<std::size_t>(c) * static_cast<std::size_t>(h * w), 0.0) {}
  double& at(int c, int y, int x) {
    return values[static_cast<std::size_t>((c * height + y) * width + x)];
  }
  [[nodiscard]] double at(int c, int y, int x) const {
    return values[static_cast<std::size_t>((c * height + y) * width + x)];
  }
  [[nodiscard]] int tokens() const { return height * width; }
  [[nodiscard]] double token(int c, int t) const {
    return values[static_cast<std::size_t>(c * tokens() + t)];
  }
  double& token(int c, int t) { return values[static_cast<std::size_t>(c * tokens() + t)]; }
  [[nodiscard]] Map slice(int first, int count) const {
    Map part(count, height, width);
    const auto begin = values.begin() + static_cast<std::ptrdiff_t>(first * tokens());
    std::copy_n(begin, part.values.size(), part.values.begin());
    return part;
  }
};

inline Map concat(const std::vector<Map>& maps) {
  int channels = 0;
  for (const Map& map : maps) channels += map.channels;
  Map all(channels, maps[0].height, maps[0].width);
  auto out = all.values.begin();
  for (const Map& map : maps) out = std::copy(map.values.begin(), map.values.end(), out);
  return all;
}

inline Map add(Map a, const Map& b, double factor = 1.0) {
  for (std::size_t i = 0; i < a.values.size(); ++i) a.values[i] += factor * b.values[i];
  return a;
}

inline Map doubled(const Map& x) {
  Map y(x.channels, 2 * x.height, 2 * x.width);
  for (int c = 0; c < y.channels; ++c) {
    for (int i = 0; i < y.height; ++i) {
      for (int j = 0; j < y.width; ++j) y.at(c, i, j) = x.at(c, i / 2, j / 2);
    }
  }
  return y;
}

inline Map halved(const Map& x) {
  Map y(x.channels, x.height / 2, x.width / 2);
  for (int c = 0; c < y.channels; ++c) {
    for (int i = 0; i < y.height; ++i) {
      for (int j = 0; j < y.width; ++j) {
        y.at(c, i, j) = (x.at(c, 2 * i, 2 * j) + x.at(c, 2 * i, 2 * j + 1) +
                         x.at(c, 2 * i + 1, 2 * j) + x.at(c, 2 * i + 1, 2 * j + 1)) /
                        4.0;
      }
    }
  }
  return y;
}

inline void softmax(std::vector<double>& values) {
  const double top = *std::max_element(values.begin(), values.end());
  double sum = 0.0;
  for (double& value : values) sum += value = std::exp(value - top);
  for (double& value : values) value /= sum;
}

inline double gelu(double x) { return 0.5 * x * (1.0 + std::erf(x / std::sqrt(2.0))); }

class Twin {
 public:
  Twin(Scale scale, const std::vector<NamedTensor>& tensors) : table_(table_of(scale)) {
    for (const NamedTensor& tensor : tensors) tensors_[tensor.name] = &tensor;
  }

  struct Level {
    Map box, classes;
  };

  /// The three levels' logits of layers "model.0" ... "model.32".
  [[nodiscard]] std::array<Level, 3> run(const Map& image) const {
    const bool deep = table_.deep_inner;
    const Map x1 = conv("1", conv("0", image, 2), 2, 2);
    const Map p3 = dsc3k2("4", conv("3", dsc3k2("2", x1, deep), 2, 4), deep);
    const Map p4 = a2c2f("6", ds_conv("5", p3, 2), 4);
    const Map p5 = a2c2f("8", ds_conv("7", p4, 2), 1);
    const Map x9 = hyper_ace("9", p3, p4, p5);
    const Map x10 = doubled(x9);
    Map x11 = halved(x9);
    if (has("11.channel_adjust.conv.weight")) x11 = conv("11.channel_adjust", x11);
    const Map x12 = tunnel("12", p4, x9), x13 = tunnel("13", p3, x10),
              x14 = tunnel("14", p5, x11);
    const Map x17 = dsc3k2("17", concat({doubled(x14), x12}), true);
    const Map x18 = tunnel("18", x17, x9);
    const Map x21 = dsc3k2("21", concat({doubled(x17), x13}), true);
    const Map x23 = tunnel("23", x21, conv("22", x10));
    const Map x26 = dsc3k2("26", concat({conv("24", x23, 2), x18}), true);
    const Map x27 = tunnel("27", x26, x9);
    const Map x30 = dsc3k2("30", concat({conv("28", x26, 2), x14}), true);
    const Map x31 = tunnel("31", x30, x11);
    return {head("0", x23), head("1", x27), head("2", x31)};
  }

 private:
  [[nodiscard]] bool has(const std::string& name) const {
    return tensors_.count("model." + name) != 0;
  }
  [[nodiscard]] const NamedTensor& tensor(const std::string& name) const {
    return *tensors_.at("model." + name);
  }
  /// Zero padding k / 2.
  [[nodiscard]] Map plain_conv(const std::string& weight_name, const Map& x, int stride = 1,
                               int groups = 1) const {
    const NamedTensor& weight = tensor(weight_name);
    const int out = static_cast<int>(weight.shape[0]), in = static_cast<int>(weight.shape[1]),
              k = static_cast<int>(weight.shape[2]), pad = k / 2;
    EXPECT_EQ(in * groups, x.channels) << weight_name;
    Map y(out, (x.height + 2 * pad - k) / stride + 1, (x.width + 2 * pad - k) / stride + 1);
    for (int o = 0; o < out; ++o) {
      const int first = o / (out / groups) * in;
      for (int c = 0; c < in; ++c) {
        for (int dy = 0; dy < k; ++dy) {
          for (int dx = 0; dx < k; ++dx) {
            const double w =
                weight.values[static_cast<std::size_t>(((o * in + c) * k + dy) * k + dx)];
            for (int i = 0; i < y.height; ++i) {
              const int row = i * stride + dy - pad;
              if (row < 0 || row >= x.height) continue;
              for (int j = 0; j < y.width; ++j) {
                const int column = j * stride + dx - pad;
                if (column < 0 || column >= x.width) continue;
                y.at(o, i, j) += w * x.at(first + c, row, column);
              }
            }
          }
        }
      }
    }
    return y;
  }
  [[nodiscard]] Map norm(const std::string& name, Map x, bool activate) const {
    for (int c = 0; c < x.channels; ++c) {
      const auto value = [&](const char* leaf) {
        return double{tensor(name + ".bn." + leaf).values[static_cast<std::size_t>(c)]};
      };
      const double gain = value("weight") / std::sqrt(value("running_var") + 1e-3);
      for (int t = 0; t < x.tokens(); ++t) {
        const double v = (x.token(c, t) - value("running_mean")) * gain + value("bias");
        x.token(c, t) = activate ? v / (1.0 + std::exp(-v)) : v;
      }
    }
    return x;
  }
  [[nodiscard]] Map conv(const std::string& name, const Map& x, int stride = 1, int groups = 1,
                         bool activate = true) const {
    return norm(name, plain_conv(name + ".conv.weight", x, stride, groups), activate);
  }
  [[nodiscard]] Map ds_conv(const std::string& name, const Map& x, int stride = 1) const {
    const Map deep = plain_conv(name + ".dw.weight", x, stride, x.channels);
    return norm(name, plain_conv(name + ".pw.weight", deep), true);
  }
  [[nodiscard]] Map bottleneck(const std::string& name, const Map& x) const {
    return add(x, ds_conv(name + ".cv2", ds_conv(name + ".cv1", x)));
  }
  [[nodiscard]] Map dsc3k(const std::string& name, const Map& x) const {
    const Map deep =
        bottleneck(name + ".m.1", bottleneck(name + ".m.0", conv(name + ".cv1", x)));
    return conv(name + ".cv3", concat({deep, conv(name + ".cv2", x)}));
  }
  [[nodiscard]] Map dsc3k2(const std::string& name, const Map& x, bool deep) const {
    const Map both = conv(name + ".cv1", x);
    const int half = both.channels / 2;
    std::vector<Map> parts{both.slice(0, half), both.slice(half, half)};
    const int repeats = table_.repeats(2);
    for (int i = 0; i < repeats; ++i) {
      const std::string inner = name + ".m." + std::to_string(i);
      parts.push_back(deep ? dsc3k(inner, parts.back()) : bottleneck(inner, parts.back()));
    }
    return conv(name + ".cv2", concat(parts));
  }

  /// Heads of 32 channels; token t attends to the tokens of its own band.
  [[nodiscard]] Map attention(const std::string& name, const Map& x, int area) const {
    const Map qk = conv(name + ".qk", x, 1, 1, false), v = conv(name + ".v", x, 1, 1, false);
    const Map pe = conv(name + ".pe", v, 1, v.channels, false);
    Map mixed = pe;
    const int band = x.tokens() / area;
    for (int h = 0; h < x.channels / 32; ++h) {
      for (int t = 0; t < x.tokens(); ++t) {
        const int first = t / band * band;
        std::vector<double> weight(static_cast<std::size_t>(band), 0.0);
        for (int u = 0; u < band; ++u) {
          double dot = 0.0;
          for (int c = 0; c < 32; ++c) {
            dot += qk.token(32 * h + c, t) * qk.token(x.channels + 32 * h + c, first + u);
          }
          weight[static_cast<std::size_t>(u)] = dot / std::sqrt(32.0);
        }
        softmax(weight);
        for (int c = 32 * h; c < 32 * (h + 1); ++c) {
          for (int u = 0; u < band; ++u) {
            mixed.token(c, t) += weight[static_cast<std::size_t>(u)] * v.token(c, first + u);
          }
        }
      }
    }
    return conv(name + ".proj", mixed, 1, 1, false);
  }
  [[nodiscard]] Map attention_block(const std::string& name, const Map& x, int area) const {
    const Map y = add(x, attention(name + ".attn", x, area));
    return add(y, conv(name + ".mlp.1", conv(name + ".mlp.0", y), 1, 1, false));
  }
  [[nodiscard]] Map a2c2f(const std::string& name, const Map& x, int area) const {
    std::vector<Map> parts{conv(name + ".cv1", x)};
    const int repeats = table_.repeats(4);
    for (int i = 0; i < repeats; ++i) {
      const std::string pair = name + ".m." + std::to_string(i);
      parts.push_back(attention_block(pair + ".1",
                                      attention_block(pair + ".0", parts.back(), area), area));
    }
    Map y = conv(name + ".cv2", concat(parts));
    if (!has(name + ".gamma")) return y;
    for (int c = 0; c < y.channels; ++c) {
      const double gamma = tensor(name + ".gamma").values[static_cast<std::size_t>(c)];
      for (int t = 0; t < y.tokens(); ++t)
        y.token(c, t) = x.token(c, t) + gamma * y.token(c, t);
    }
    return y;
  }

  /// y[r] = sum over c of W[r, c] x[c] + b[r].
  [[nodiscard]] std::vector<double> linear(const std::string& name,
                                           const std::vector<double>& x) const {
    const NamedTensor &weight = tensor(name + ".weight"), &bias = tensor(name + ".bias");
    std::vector<double> y(bias.values.begin(), bias.values.end());
    for (std::size_t r = 0; r < y.size(); ++r) {
      for (std::size_t c = 0; c < x.size(); ++c)
        y[r] += weight.values[r * x.size() + c] * x[c];
    }
    return y;
  }
  [[nodiscard]] std::vector<double> token_of(const Map& x, int t) const {
    std::vector<double> token;
    for (int c = 0; c < x.channels; ++c) token.push_back(x.token(c, t));
    return token;
  }
  /// [hyperedge][token], each row sums to 1. Head by head: the heads' logits are averaged.
  [[nodiscard]] std::vector<std::vector<double>> participation(const std::string& name,
                                                               const Map& x) const {
    const int d = x.channels, heads = d / 16;
    std::vector<double> context(static_cast<std::size_t>(2 * d), 0.0);
    for (int c = 0; c < d; ++c) {
      double mean = 0.0, top = x.token(c, 0);
      for (int t = 0; t < x.tokens(); ++t) {
        mean += x.token(c, t) / x.tokens();
        top = std::max(top, x.token(c, t));
      }
      context[static_cast<std::size_t>(c)] = mean;
      context[static_cast<std::size_t>(d + c)] = top;
    }
    std::vector<double> prototypes = linear(name + ".context_net", context);
    const NamedTensor& base = tensor(name + ".prototype_base");
    for (std::size_t i = 0; i < prototypes.size(); ++i) prototypes[i] += base.values[i];
    std::vector<std::vector<double>> rows(prototypes.size() / static_cast<std::size_t>(d),
                                          std::vector<double>());
    for (int t = 0; t < x.tokens(); ++t) {
      const std::vector<double> token = linear(name + ".pre_head_proj", token_of(x, t));
      for (std::size_t e = 0; e < rows.size(); ++e) {
        double mean = 0.0;
        for (int h = 0; h < heads; ++h) {
          double dot = 0.0;
          for (int c = 16 * h; c < 16 * (h + 1); ++c) {
            dot += token[static_cast<std::size_t>(c)] *
                   prototypes[e * static_cast<std::size_t>(d) + static_cast<std::size_t>(c)];
          }
          mean += dot / std::sqrt(16.0) / heads;
        }
        rows[e].push_back(mean);
      }
    }
    for (auto& row : rows) softmax(row);
    return rows;
  }
  [[nodiscard]] Map hypergraph(const std::string& name, const Map& x) const {
    const auto a = participation(name + ".edge_generator", x);
    std::vector<std::vector<double>> edges;
    for (const auto& row : a) {
      std::vector<double> sum(static_cast<std::size_t>(x.channels), 0.0);
      for (int t = 0; t < x.tokens(); ++t) {
        for (int c = 0; c < x.channels; ++c) {
          sum[static_cast<std::size_t>(c)] += row[static_cast<std::size_t>(t)] * x.token(c, t);
        }
      }
      edges.push_back(linear(name + ".edge_proj.0", sum));
      for (double& value : edges.back()) value = gelu(value);
    }
    Map y = x;
    for (int t = 0; t < x.tokens(); ++t) {
      std::vector<double> gathered(static_cast<std::size_t>(x.channels), 0.0);
      for (std::size_t e = 0; e < edges.size(); ++e) {
        for (std::size_t c = 0; c < gathered.size(); ++c) {
          gathered[c] += a[e][static_cast<std::size_t>(t)] * edges[e][c];
        }
      }
      const std::vector<double> out = linear(name + ".node_proj.0", gathered);
      for (int c = 0; c < x.channels; ++c)
        y.token(c, t) += gelu(out[static_cast<std::size_t>(c)]);
    }
    return y;
  }
  [[nodiscard]] Map c3ah(const std::string& name, const Map& x) const {
    return conv(name + ".cv3", concat({hypergraph(name + ".m.hgnn", conv(name + ".cv1", x)),
                                       conv(name + ".cv2", x)}));
  }
  [[nodiscard]] Map hyper_ace(const std::string& name, const Map& p3, const Map& p4,
                              const Map& p5) const {
    const Map fused = conv(name + ".fuse.conv_out", concat({halved(p3), p4, doubled(p5)}));
    const Map y = conv(name + ".cv1", fused);
    const int c = y.channels / 3;
    const Map low = y.slice(2 * c, c), high = y.slice(c, c);
    std::vector<Map> parts{y.slice(0, c), c3ah(name + ".branch1", high), low};
    for (int i = 0; i < table_.repeats(2); ++i) {
      parts.push_back(dsc3k(name + ".m." + std::to_string(i), parts.back()));
    }
    parts.push_back(c3ah(name + ".branch2", high));
    return conv(name + ".cv2", concat(parts));
  }
  [[nodiscard]] Map tunnel(const std::string& name, const Map& a, const Map& b) const {
    return add(a, b, tensor(name + ".gate").values[0]);
  }

  [[nodiscard]] Map output(const std::string& name, const Map& x) const {
    Map y = plain_conv(name + ".weight", x);
    const NamedTensor& bias = tensor(name + ".bias");
    for (int c = 0; c < y.channels; ++c) {
      for (int t = 0; t < y.tokens(); ++t)
        y.token(c, t) += bias.values[static_cast<std::size_t>(c)];
    }
    return y;
  }
  [[nodiscard]] Level head(const std::string& level, const Map& x) const {
    const std::string box = "32.cv2." + level, classes = "32.cv3." + level;
    const Map first = conv(classes + ".0.1", conv(classes + ".0.0", x, 1, x.channels));
    const Map second =
        conv(classes + ".1.1", conv(classes + ".1.0", first, 1, first.channels));
    return {output(box + ".2", conv(box + ".1", conv(box + ".0", x))),
            output(classes + ".2", second)};
  }

  const ScaleTable& table_;
  std::map<std::string, const NamedTensor*> tensors_;
};

}  // namespace segsim::perception::yolov13

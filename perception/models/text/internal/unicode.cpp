#include "perception/models/text/internal/tokenizers.h"

#include <algorithm>

namespace segsim::perception {

std::vector<char32_t> code_points(std::string_view text) {
  constexpr char32_t kBroken = 0xFFFD;
  std::vector<char32_t> points;
  for (std::size_t i = 0; i < text.size();) {
    const auto lead = static_cast<unsigned char>(text[i]);
    const int more = lead < 0x80   ? 0
                     : lead < 0xC2 ? -1
                     : lead < 0xE0 ? 1
                     : lead < 0xF0 ? 2
                     : lead < 0xF5 ? 3
                                   : -1;
    char32_t point = more <= 0 ? lead : lead & (0x3FU >> static_cast<unsigned>(more));
    bool whole = more >= 0 && i + static_cast<std::size_t>(std::max(more, 0)) < text.size();
    for (int k = 1; whole && k <= more; ++k) {
      const auto next = static_cast<unsigned char>(text[i + static_cast<std::size_t>(k)]);
      whole = (next & 0xC0U) == 0x80U;
      point = point << 6U | (next & 0x3FU);
    }
    points.push_back(whole ? point : kBroken);
    i += whole ? static_cast<std::size_t>(more) + 1 : 1;
  }
  return points;
}

void append_utf8(std::string& text, char32_t point) {
  const auto byte = [&](char32_t value) { text.push_back(static_cast<char>(value)); };
  if (point < 0x80) {
    byte(point);
  } else if (point < 0x800) {
    byte(0xC0 | point >> 6U);
    byte(0x80 | (point & 0x3FU));
  } else if (point < 0x10000) {
    byte(0xE0 | point >> 12U);
    byte(0x80 | (point >> 6U & 0x3FU));
    byte(0x80 | (point & 0x3FU));
  } else {
    byte(0xF0 | point >> 18U);
    byte(0x80 | (point >> 12U & 0x3FU));
    byte(0x80 | (point >> 6U & 0x3FU));
    byte(0x80 | (point & 0x3FU));
  }
}

char32_t lower_case(char32_t point) {
  const bool ascii = point >= U'A' && point <= U'Z';
  const bool latin = point >= 0xC0 && point <= 0xDE && point != 0xD7;
  return ascii || latin ? point + 0x20 : point;
}

bool is_space(char32_t point) {
  return point == U' ' || (point >= 0x09 && point <= 0x0D) || point == 0x85 || point == 0xA0 ||
         (point >= 0x2000 && point <= 0x200A) || point == 0x2028 || point == 0x2029 ||
         point == 0x202F || point == 0x205F || point == 0x3000;
}

bool is_punctuation(char32_t point) {
  const auto within = [&](char32_t low, char32_t high) {
    return point >= low && point <= high;
  };
  return within(0x21, 0x2F) || within(0x3A, 0x40) || within(0x5B, 0x60) ||
         within(0x7B, 0x7E) ||
         (within(0xA1, 0xBF) && point != 0xAA && point != 0xB5 && point != 0xBA) ||
         point == 0xD7 || point == 0xF7 || within(0x2010, 0x303F);
}

std::vector<std::string> lines_of(const std::string& text) {
  std::vector<std::string> lines;
  for (std::size_t start = 0; start < text.size();) {
    const std::size_t end = std::min(text.find('\n', start), text.size());
    std::string line = text.substr(start, end - start);
    if (!line.empty() && line.back() == '\r') line.pop_back();
    lines.push_back(std::move(line));
    start = end + 1;
  }
  return lines;
}

}  // namespace segsim::perception

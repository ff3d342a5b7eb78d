// COLMAP's sparse models, text and binary (reconstruction/datasets/internal/colmap_files.h).
// The first byte of an input says which: 'b' for binary.
#include "reconstruction/datasets/internal/colmap_files.h"

#include <cstring>

#include "tests/fuzz/fuzz_target.h"

namespace segsim::fuzz {
namespace {

class Bytes {
 public:
  template <class Number>
  Bytes& operator<<(Number value) {
    bytes_.append(reinterpret_cast<const char*>(&value), sizeof value);
    return *this;
  }
  Bytes& text(const char* value) {
    bytes_.append(value, std::strlen(value) + 1);
    return *this;
  }
  [[nodiscard]] const std::string& all() const { return bytes_; }

 private:
  std::string bytes_;
};

std::string binary_model() {
  Bytes cameras, images, points;
  cameras << std::uint64_t{1} << std::uint32_t{1} << std::int32_t{1} << std::uint64_t{640}
          << std::uint64_t{480} << 500.0 << 500.0 << 320.0 << 240.0;
  images << std::uint64_t{1} << std::uint32_t{7} << 1.0 << 0.0 << 0.0 << 0.0 << 1.0 << 2.0
         << 3.0 << std::uint32_t{1};
  images.text("a.jpg") << std::uint64_t{1} << 10.0 << 20.0 << std::int64_t{4};
  points << std::uint64_t{1} << std::uint64_t{4} << 1.0 << 2.0 << 3.0 << std::uint8_t{1}
         << std::uint8_t{2} << std::uint8_t{3} << 0.5 << std::uint64_t{1} << std::uint32_t{7}
         << std::uint32_t{0};
  return join_parts({cameras.all(), images.all(), points.all()});
}

}  // namespace

void parse(const std::string& bytes) {
  const bool binary = bytes.starts_with('b');
  const std::string ending = binary ? ".bin" : ".txt", other = binary ? ".txt" : ".bin";
  const std::vector<std::string> parts =
      split_parts(bytes.empty() ? bytes : bytes.substr(1), 3);
  const char* const names[] = {"cameras", "images", "points3D"};
  for (std::size_t i = 0; i < 3; ++i) {
    (void)in_file(parts[i], names[i] + ending);
    std::filesystem::remove(work_folder() / (names[i] + other));
  }
  const auto model = reconstruction::internal::read_colmap_model(work_folder());
  (void)reconstruction::internal::common_lens(model, work_folder());
  for (const auto& image : model.images) {
    for (const std::uint32_t point : image.seen_points) (void)model.points_m.at(point);
  }
}

std::vector<std::string> seeds() {
  return {"b" + binary_model(),
          "t" + join_parts({"# cameras\n1 OPENCV 640 480 500 500 320 240 0.1 0 0 0\n",
                            "# images\n7 1 0 0 0 1 2 3 1 a.jpg\n10 20 4 11 21 -1\n",
                            "# points\n4 1 2 3 10 20 30 0.5 7 0\n"})};
}

}  // namespace segsim::fuzz

#pragma once

/// @file
/// One value per cell of a map that grows. A layer is a window of a larger plane of cells, so
/// that growing moves nothing: the cells around the window are there already. What nobody
/// wrote to takes no memory, as the system hands out pages of zeros on the first write only.
///
/// Layers that are made and grown alike have planes of one size, in which a cell has one
/// index: what searches walk on. At least a rim of one cell lies around every window and holds
/// zeros, so that a neighbour's index is always valid.

#include <algorithm>
#include <array>
#include <cassert>
#include <cstddef>
#include <cstring>
#include <memory>
#include <optional>
#include <type_traits>

#include "core/check.h"
#include "core/image.h"
#include "nav/grid/grid.h"

namespace segsim::nav {

namespace internal {

/// Memory of zeros that is given back at the end. @throws std::bad_alloc
struct ZeroPages {
  explicit ZeroPages(std::size_t bytes);
  ~ZeroPages();
  ZeroPages(const ZeroPages&) = delete;
  ZeroPages& operator=(const ZeroPages&) = delete;
  void* data = nullptr;
  std::size_t bytes;
};

}  // namespace internal

template <class Pixel>
class GridLayer {
  static_assert(std::is_trivially_copyable_v<Pixel>);

 public:
  GridLayer() = default;
  /// @param fill  Of every cell, now and when cells are added. Other than zeros it costs
  /// memory.
  GridLayer(int width_cells, int height_cells, const Pixel& fill = {}) {
    reset(width_cells, height_cells, fill);
  }
  GridLayer(const GridLayer& other)
      : plane_(other.plane_),
        low_(other.low_),
        width_(other.width_),
        height_(other.height_),
        fill_(other.fill_) {
    if (!other.pages_) return;
    take_pages();
    first_ = plane() + offset(low_);
    for (int j = 0; j < height_; ++j) std::copy_n(other.row(j), width_, row(j));
  }
  GridLayer(GridLayer&&) noexcept = default;
  GridLayer& operator=(GridLayer&&) noexcept = default;
  GridLayer& operator=(const GridLayer& other) { return *this = GridLayer(other); }
  ~GridLayer() = default;

  /// As if constructed anew.
  void reset(int width_cells, int height_cells, const Pixel& fill = {}) {
    SEGSIM_CHECK(width_cells >= 0 && height_cells >= 0, "negative size of a layer");
    width_ = width_cells;
    height_ = height_cells;
    fill_ = fill;
    take_plane();
    fill_box({Cell(0), Cell(width_ - 1, height_ - 1)});
  }

  /// Begins with the size of a frame, and later grows with it; of nullopt nothing is taken.
  void cover(const GridFrame& frame, const std::optional<Margins>& added,
             const Pixel& fill = {}) {
    if (empty()) {
      reset(frame.width_cells, frame.height_cells, fill);
    } else if (added && added->any()) {
      grow(*added);
    }
  }

  /// Adds cells on the sides; what is there stays, and so do the addresses of its cells unless
  /// the plane had to be replaced by a larger one.
  void grow(const Margins& added) {
    const Cell low = low_ - Cell(added.left, added.bottom);
    const Cell old(width_, height_);
    width_ += added.left + added.right;
    height_ += added.bottom + added.top;
    if (low.x > 0 && low.y > 0 && low.x + width_ < plane_.x && low.y + height_ < plane_.y) {
      low_ = low;
      first_ = plane() + offset(low_);
    } else {
      const GridLayer before = std::move(*this);
      *this = GridLayer();
      width_ = before.width_;
      height_ = before.height_;
      fill_ = before.fill_;
      take_plane();
      for (int j = 0; j < old.y; ++j) {
        std::copy_n(before.row(j), old.x, row(j + added.bottom) + added.left);
      }
    }
    fill_box({Cell(0), Cell(width_ - 1, added.bottom - 1)});
    fill_box({Cell(0, height_ - added.top), Cell(width_ - 1, height_ - 1)});
    fill_box({Cell(0, added.bottom), Cell(added.left - 1, height_ - added.top - 1)});
    fill_box(
        {Cell(width_ - added.right, added.bottom), Cell(width_ - 1, height_ - added.top - 1)});
  }

  [[nodiscard]] int width_cells() const { return width_; }
  [[nodiscard]] int height_cells() const { return height_; }
  [[nodiscard]] bool empty() const { return width_ == 0 || height_ == 0; }
  /// From a cell to the one above it, in cells.
  [[nodiscard]] std::ptrdiff_t stride() const { return plane_.x; }
  /// Of a cell in the plane; the same until a growth replaces the plane.
  [[nodiscard]] std::ptrdiff_t index_of(const Cell& cell) const { return offset(low_ + cell); }
  [[nodiscard]] Cell cell_of(std::ptrdiff_t index) const {
    return Cell(static_cast<int>(index % plane_.x), static_cast<int>(index / plane_.x)) - low_;
  }
  /// The plane, to be indexed.
  Pixel* plane() { return static_cast<Pixel*>(pages_->data); }
  const Pixel* plane() const { return static_cast<const Pixel*>(pages_->data); }
  /// Takes the window and the size of the plane of another layer: cells have the same indices
  /// in both then. What is stored stays with its index, or is gone if the plane has to change.
  template <class Other>
  void cover_like(const GridLayer<Other>& other) {
    const bool same_plane = plane_ == other.plane_;
    plane_ = other.plane_;
    low_ = other.low_;
    width_ = other.width_;
    height_ = other.height_;
    if (!same_plane) take_pages();
    first_ = plane() + offset(low_);
  }
  [[nodiscard]] bool contains(int x, int y) const {
    return x >= 0 && y >= 0 && x < width_ && y < height_;
  }
  Pixel& operator()(int x, int y) {
    assert(contains(x, y));
    return row(y)[x];
  }
  const Pixel& operator()(int x, int y) const {
    assert(contains(x, y));
    return row(y)[x];
  }
  Pixel* row(int y) { return first_ + y * stride(); }
  const Pixel* row(int y) const { return first_ + y * stride(); }

 private:
  template <class>
  friend class GridLayer;
  static constexpr int kRoom = 80;   // What a growth may add to half of a window.
  static constexpr int kStep = 256;  // Planes of few sizes can be used again.

  /// A plane with room on all sides of the window.
  void take_plane() {
    const Cell window(width_, height_);
    const Cell wanted = window + 2 * (window / 2 + kRoom);
    plane_ = (wanted + (kStep - 1)) / kStep * kStep;
    low_ = (plane_ - window) / 2;
    take_pages();
    first_ = plane() + offset(low_);
  }
  void take_pages() {
    pages_.reset();  // The same block may be handed out again.
    pages_ = std::make_unique<internal::ZeroPages>(static_cast<std::size_t>(plane_.x) *
                                                   static_cast<std::size_t>(plane_.y) *
                                                   sizeof(Pixel));
  }
  void fill_box(const CellBox& box) {
    constexpr std::array<unsigned char, sizeof(Pixel)> kZeros{};
    // Whether the bits are zero, as those of fresh pages are: no question of values.
    // NOLINTNEXTLINE(bugprone-suspicious-memory-comparison)
    if (box.empty() || std::memcmp(&fill_, kZeros.data(), kZeros.size()) == 0) return;
    for (int j = box.low.y; j <= box.high.y; ++j) {
      std::fill_n(row(j) + box.low.x, box.width(), fill_);
    }
  }
  [[nodiscard]] std::ptrdiff_t offset(const Cell& cell) const {
    return static_cast<std::ptrdiff_t>(cell.y) * plane_.x + cell.x;
  }

  std::unique_ptr<internal::ZeroPages> pages_;
  Cell plane_{0};  ///< Its size,
  Cell low_{0};    ///< and where in it the layer's cell (0, 0) lies.
  int width_ = 0, height_ = 0;
  Pixel* first_ = nullptr;  ///< Cell (0, 0).
  Pixel fill_{};
};

/// Cells of a layer or pixels of an image, to read.
template <class Pixel>
class GridView {
 public:
  GridView() = default;
  GridView(const GridLayer<Pixel>& layer)  // NOLINT(google-explicit-constructor)
      : width_(layer.width_cells()), height_(layer.height_cells()), stride_(layer.stride()) {
    if (!layer.empty()) first_ = layer.row(0);
  }
  GridView(const core::Image<Pixel>& image)  // NOLINT(google-explicit-constructor)
      : first_(image.data()),
        width_(image.width_px()),
        height_(image.height_px()),
        stride_(image.width_px()) {}

  [[nodiscard]] int width_cells() const { return width_; }
  [[nodiscard]] int height_cells() const { return height_; }
  [[nodiscard]] std::ptrdiff_t stride() const { return stride_; }
  [[nodiscard]] bool empty() const { return width_ == 0 || height_ == 0; }
  [[nodiscard]] const Pixel* row(int y) const { return first_ + y * stride_; }
  const Pixel& operator()(int x, int y) const { return row(y)[x]; }

 private:
  const Pixel* first_ = nullptr;
  int width_ = 0, height_ = 0;
  std::ptrdiff_t stride_ = 0;
};

/// Whether both have as many rows and columns.
template <class A, class B>
[[nodiscard]] bool same_size(const A& a, const B& b) {
  return a.width_cells() == b.width_cells() && a.height_cells() == b.height_cells();
}

}  // namespace segsim::nav

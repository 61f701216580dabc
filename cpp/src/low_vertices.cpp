#include "low_vertices.hpp"

#include <algorithm>

namespace vsr2 {
namespace {

using Eigen::Vector3d;

// Heights of bands above the lowest vertex, per radius, and how many vertices they may hold. No bit
// depends on them, and speed hardly does: by 5 % from a quarter of the near band to four times it.
constexpr double kNearBand = 0.02;
constexpr double kLeastNearBand = kNearBand / 32;
constexpr std::size_t kNear = 128;
constexpr double kFarBand = 0.32;
constexpr double kLeastFarBand = 2 * kNearBand;
constexpr std::size_t kFar = 1024;

constexpr std::size_t whole_blocks(std::size_t count) {
  return (count + PointColumns::kBlock - 1) / PointColumns::kBlock * PointColumns::kBlock;
}

}  // namespace

LowVertices::Gathered::Gathered(std::size_t capacity)
    : capacity_(whole_blocks(capacity)), columns_(3 * capacity_) {
  index_.reserve(capacity_);
}

bool LowVertices::Gathered::holds(const Vector3d& up) const {
  return reach_ >= 0.0 && (up - up_).squaredNorm() <= reach_ * reach_;
}

PointView LowVertices::Gathered::view() const {
  const double* x = columns_.data();
  return {x, x + capacity_, x + 2 * capacity_, index_.size()};
}

// The height of a vertex changes by at most |up - up_| times its radius, and so does the lowest one's.
void LowVertices::Gathered::gather(const PointView& points, const Gathered* indices,
                                   const Vector3d& up, double radius, double band, double least,
                                   double wanted, std::size_t room) {
  const double lowest = points.along(first_support(points, -up), up);
  up_ = up;
  for (; band >= least; band *= 0.5) {
    index_.clear();
    reach_ = 0.5 * (band - wanted);
    const double limit = lowest + band * radius;
    std::size_t i = 0;
    for (; i < points.size; ++i) {
      if (points.along(i, up) > limit) continue;
      if (index_.size() == room) break;
      const std::size_t found = index_.size();
      columns_[found] = points.x[i];
      columns_[capacity_ + found] = points.y[i];
      columns_[2 * capacity_ + found] = points.z[i];
      index_.push_back(indices ? indices->index(i) : i);
    }
    if (i == points.size) break;
    index_.clear();
  }
  // Whole blocks for the scan; the first again cannot win, being later.
  for (std::size_t i = index_.size(); i % PointColumns::kBlock != 0; ++i)
    for (std::size_t k = 0; k < 3; ++k) columns_[k * capacity_ + i] = columns_[k * capacity_];
}

LowVertices::LowVertices(const PointView& all, double radius)
    : all_(all), radius_(radius), far_(all.size > kFar ? kFar : 0), near_(std::min(all.size, kNear)) {}

void LowVertices::clear() {
  far_.clear();
  near_.clear();
}

// What the low vertices are gathered from, or searched in where there are too many of them: null for
// all vertices.
const LowVertices::Gathered* LowVertices::source() const { return far_.empty() ? nullptr : &far_; }

std::size_t LowVertices::lowest(const Vector3d& up) {
  if (all_.size > kFar && !far_.holds(up)) {
    far_.gather(all_, nullptr, up, radius_, kFarBand, kLeastFarBand, kNearBand, kFar);
    near_.clear();
  }
  if (!near_.holds(up))
    near_.gather(source() ? source()->view() : all_, source(), up, radius_, kNearBand,
                 kLeastNearBand, 0.0, kNear);
  const Gathered* low = near_.empty() ? source() : &near_;
  const std::size_t i = first_support(low ? low->view() : all_, -up);
  return low ? low->index(i) : i;
}

bool LowVertices::is_alone(std::size_t vertex, const Vector3d& up, double same_height) const {
  const Gathered* low = near_.empty() ? source() : &near_;
  const PointView view = low ? low->view() : all_;
  const double limit = all_.along(vertex, up) + same_height;
  int count = 0;
  for (std::size_t i = 0; i < view.size; ++i) count += view.along(i, up) <= limit;
  return count == 1;
}

}  // namespace vsr2

#pragma once
// The lowest vertex of a turning hull, found among the few that can be it; private to the core.

#include <cstddef>
#include <vector>

#include "hull_scan.hpp"

namespace vsr2 {

/// Looks for the lowest vertex among those that were low in a direction near by, and gathers them
/// again once another could be the lowest; so answers have the bits of a search among all. Of a hull
/// of many vertices the low ones are gathered from a wider set, which lasts longer.
class LowVertices {
 public:
  /// @param all vertices that outlive this, at most `radius` [m] from the origin.
  LowVertices(const PointView& all, double radius);

  /// Forgets what was gathered.
  void clear();
  /// Index of the first lowest vertex along `up`, a unit vector.
  std::size_t lowest(const Eigen::Vector3d& up);
  /// Whether no other vertex is as low as `vertex`, the latest lowest one, but for `same_height` [m].
  bool is_alone(std::size_t vertex, const Eigen::Vector3d& up, double same_height) const;

 private:
  /// Vertices within a band above the lowest one, in rising order of their indices.
  class Gathered {
   public:
    explicit Gathered(std::size_t capacity);
    void clear() { reach_ = -1.0; }
    bool holds(const Eigen::Vector3d& up) const;
    bool empty() const { return index_.empty(); }
    PointView view() const;
    std::size_t index(std::size_t i) const { return index_[i]; }
    /// From `points`, whose indices are `indices` or, where null, their places; none where more than
    /// `room` lie within the band `least`. `wanted` [1] is what is left of the band for others.
    void gather(const PointView& points, const Gathered* indices, const Eigen::Vector3d& up,
                double radius, double band, double least, double wanted, std::size_t room);

   private:
    std::size_t capacity_;
    std::vector<double> columns_;
    std::vector<std::size_t> index_;
    Eigen::Vector3d up_ = Eigen::Vector3d::Zero();
    double reach_ = -1.0;  ///< how far `up` may be from up_; negative: nothing was gathered
  };

  const Gathered* source() const;

  PointView all_;
  double radius_;
  Gathered far_;
  Gathered near_;
};

}  // namespace vsr2

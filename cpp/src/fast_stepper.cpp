#include "fast_stepper.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include <BulletCollision/NarrowPhaseCollision/btGjkEpaPenetrationDepthSolver.h>
#include <BulletCollision/NarrowPhaseCollision/btGjkPairDetector.h>
#include <BulletCollision/NarrowPhaseCollision/btPointCollector.h>
#include <BulletCollision/NarrowPhaseCollision/btVoronoiSimplexSolver.h>

#include "scene_shapes.hpp"
#include "vsr2/constants.hpp"
#include "vsr2/engines.hpp"

namespace vsr2 {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// Bullet's search takes four points that span less than this for points of one plane [m^3].
constexpr double kFlatVolume = 1e-8;

const Part& only_part(const std::vector<Part>& parts) { return parts.front(); }

}  // namespace

FastRefusal fast_refusal(const Scene& scene) {
  const RockSpec& rock = scene.rock();
  const PedestalSpec& pedestal = scene.pedestal();
  if (rock.parts.size() != 1) return FastRefusal::several_parts;
  if (pedestal.parts.size() != 1 || !std::holds_alternative<BoxPart>(only_part(pedestal.parts)))
    return FastRefusal::pedestal_not_a_box;
  if (!scene.engine().cone_friction) return FastRefusal::no_friction_cone;
  for (std::size_t i = 0; i < kContactParameters.size(); ++i)
    if (!kContactParameters[i].fast && (rock.material.all[i] > 0 || pedestal.material.all[i] > 0))
      return FastRefusal::contact_parameter;
  if (!(scene.engine().collision_margin > 0) &&
      std::holds_alternative<HullPart>(only_part(rock.parts)))
    return FastRefusal::no_margin;
  return FastRefusal::none;
}

FastModel::FastModel(const Scene& scene) {
  engine = scene.engine();
  const RockSpec& rock = scene.rock();
  const Scene::Shapes& shapes = scene.shapes();
  is_box = std::holds_alternative<BoxPart>(only_part(rock.parts));
  const bool pedestal_is_wrapped = shapes.pedestal->isCompound();
  is_wrapped = shapes.rock->isCompound() || pedestal_is_wrapped;
  rock_is_first = shapes.rock->isCompound() && !pedestal_is_wrapped;
  const btCollisionShape* shape = shapes.rock;
  const auto& top = std::get<BoxPart>(only_part(scene.pedestal().parts));
  support_half = 0.5 * top.size;
  X_LP = {top.pose.position, top.pose.orientation.normalized()};
  const btCollisionShape* support_shape = shapes.pedestal;
  if (pedestal_is_wrapped)
    support_shape = static_cast<const btCompoundShape*>(shapes.pedestal)->getChildShape(0);
  X_BS = btTransform::getIdentity();
  if (shapes.rock->isCompound()) {
    const auto* compound = static_cast<const btCompoundShape*>(shapes.rock);
    shape = compound->getChildShape(0);
    X_BS = compound->getChildTransform(0);
  }
  p_BC = to_eigen(X_BS.getOrigin());
  R_BC = to_eigen(X_BS.getRotation()).toRotationMatrix();
  btVector3 lower;
  btVector3 upper;
  shape->getAabb(btTransform::getIdentity(), lower, upper);
  bounds_centre = to_eigen(0.5 * (lower + upper));
  bounds_half = to_eigen(0.5 * (upper - lower));
  if (is_box) {
    box_half = 0.5 * std::get<BoxPart>(only_part(rock.parts)).size;
  } else {
    hull = std::make_unique<ScannedHull>(*static_cast<const btConvexHullShape*>(shape));
    support_box =
        std::make_unique<btBoxShape>(*static_cast<const btBoxShape*>(support_shape));
    // The four points are mostly a vertex less three corners of the top, so it tells vertices apart
    // that differ by kFlatVolume over the top's area; measured so within a factor of 1.2. Rounding
    // of a height bounds it on a large top.
    same_height = std::max(3.0 * kFlatVolume / (4.0 * support_half.x() * support_half.y()), 1e-10);
    std::vector<btVector3> points;
    points.reserve(static_cast<std::size_t>(hull->getNumPoints()));
    for (int i = 0; i < hull->getNumPoints(); ++i) {
      points.push_back(X_BS(hull->getScaledPoint(i)));
      radius = std::max(radius, static_cast<double>(points.back().length()));
    }
    vertices = PointColumns(points.data(), points.size());
    margin = engine.collision_margin;
  }
  breaking_threshold =
      std::min(shapes.rock->getContactBreakingThreshold(engine.contact_breaking_threshold),
               shapes.pedestal->getContactBreakingThreshold(engine.contact_breaking_threshold));
  const double size = is_box ? box_half.norm() : radius;
  deepest = std::min(kTop.deepest_of_rock * size, kTop.deepest_of_top * support_half.minCoeff());
  guard = kTop.guard_of_margin * engine.collision_margin + kTop.guard_of_rock * size;

  mass = rock.mass;
  inertia = scene.rock_inertia();
  inverse_inertia = inertia.cwiseInverse();
  pair = combine(rock.material, scene.pedestal().material);
}

void FastStepper::clear() {
  count_ = 0;
  iterations_ = 0;
  held_ = 0;
  closed_ = 0;
  low_.clear();
}

FastStepper::Snapshot FastStepper::snapshot() const {
  return {state, contacts_, count_, held_, closed_};
}

void FastStepper::restore(const Snapshot& snapshot) {
  state = snapshot.state;
  contacts_ = snapshot.contacts;
  count_ = snapshot.count;
  held_ = snapshot.held;
  closed_ = snapshot.closed;
}

// Where an edge or a face lies flat on the top, Bullet's search ends at some point of it.
bool FastStepper::closest_by_bullet(const Support& support, Vector3d& p_W_rock,
                                    Vector3d& p_W_support, double& distance) const {
  const FastModel& m = *model_;
  const btTransform X_WS = to_bullet(Pose{state.p_WB, state.q_WB}) * m.X_BS;
  // By way of a quaternion, as Bullet keeps rotations. Of 2000 random ones 86 % have another matrix
  // then, by 1e-15 at most: R_WP itself would give a rock on a turned top other bits.
  const btTransform X_WP(support.level ? btMatrix3x3::getIdentity()
                                       : btMatrix3x3(to_bullet(Eigen::Quaterniond(support.R_WP))),
                         to_bullet(support.p_WP));
  const btConvexShape* first = m.hull.get();
  const btConvexShape* second = m.support_box.get();
  if (!m.rock_is_first) std::swap(first, second);
  btVoronoiSimplexSolver simplex;
  btGjkEpaPenetrationDepthSolver penetration;
  btGjkPairDetector detector(first, second, &simplex, &penetration);
  btGjkPairDetector::ClosestPointInput input;
  input.m_transformA = m.rock_is_first ? X_WS : X_WP;
  input.m_transformB = m.rock_is_first ? X_WP : X_WS;
  const double reach = first->getMargin() + second->getMargin() + m.breaking_threshold;
  input.m_maximumDistanceSquared = reach * reach;
  btPointCollector found;
  detector.getClosestPoints(input, found, nullptr);
  if (!found.m_hasResult) return false;
  const btVector3 on_second = found.m_pointInWorld;
  const btVector3 on_first = on_second + found.m_normalOnBInWorld * found.m_distance;
  p_W_rock = to_eigen(m.rock_is_first ? on_first : on_second);
  p_W_support = to_eigen(m.rock_is_first ? on_second : on_first);
  distance = found.m_distance;
  return true;
}

// New places and distances of the kept contacts; those that opened or slid away are dropped, the
// last taking the place of a dropped one.
void FastStepper::refresh(const RockOverTop& rock) {
  const double limit = model_->breaking_threshold;
  for (int i = 0; i < count_; ++i) {
    Contact& c = contacts_[i];
    c.r_P = rock.R_PB * c.p_B;
    c.s_P = c.p_P;
    c.distance = (rock.p_PB.z() + c.r_P.z()) - c.s_P.z();
  }
  for (int i = count_ - 1; i >= 0; --i) {
    const Contact& c = contacts_[i];
    const double dx = (rock.p_PB.x() + c.r_P.x()) - c.s_P.x();
    const double dy = (rock.p_PB.y() + c.r_P.y()) - c.s_P.y();
    if (c.distance > limit || dx * dx + dy * dy > limit * limit) {
      --count_;
      if (i != count_)
        contacts_[i] = contacts_[count_];
    }
  }
}

// Which of four contacts a fifth replaces: the one whose loss leaves the greatest area, measured
// with three points, but never the deepest (Bullet's default rule).
int FastStepper::slot_when_full(const Vector3d& point, double distance) const {
  int deepest = -1;
  double least = distance;
  for (int i = 0; i < 4; ++i) {
    if (contacts_[i].distance < least) {
      deepest = i;
      least = contacts_[i].distance;
    }
  }
  const auto at = [&](int i) -> const Vector3d& {
    const Contact& c = contacts_[i];
    return model_->rock_is_first ? c.p_B : c.p_P;
  };
  constexpr int triples[4][3] = {{1, 3, 2}, {0, 3, 2}, {0, 3, 1}, {0, 2, 1}};
  int slot = 0;
  double greatest = -1.0;
  for (int i = 0; i < 4; ++i) {
    double area = 0.0;
    if (i != deepest)
      area = (point - at(triples[i][0])).cross(at(triples[i][1]) - at(triples[i][2])).squaredNorm();
    if (area > greatest) {
      greatest = area;
      slot = i;
    }
  }
  return slot;
}

void FastStepper::add(const Vector3d& p_B, const Vector3d& p_P, double distance) {
  const FastModel& m = *model_;
  if (distance > m.breaking_threshold) return;
  const Vector3d& point = m.rock_is_first ? p_B : p_P;
  double nearest = m.breaking_threshold * m.breaking_threshold;
  int slot = -1;
  for (int i = 0; i < count_; ++i) {
    const Contact& c = contacts_[i];
    const double d = ((m.rock_is_first ? c.p_B : c.p_P) - point).squaredNorm();
    if (d < nearest) {
      nearest = d;
      slot = i;
    }
  }
  if (slot < 0) slot = count_ == 4 ? slot_when_full(point, distance) : count_++;
  Contact& c = contacts_[slot];
  c.p_B = p_B;
  c.p_P = p_P;
  c.distance = distance;
}

bool FastStepper::keeps(const Vector3d& vertex_P) const {
  const Vector3d point = vertex_P - Vector3d(0, 0, model_->margin);
  return std::any_of(contacts_.begin(), contacts_.begin() + count_, [&](const Contact& c) {
    return (c.r_P - point).norm() < model_->breaking_threshold;
  });
}

FastStepper::Verdict FastStepper::detect(const Support& support) {
  RockOverTop rock{state.q_WB.toRotationMatrix(), state.p_WB - support.p_WP};
  if (!support.level) {
    rock.R_PB = support.R_WP.transpose() * rock.R_PB;
    rock.p_PB = support.R_WP.transpose() * rock.p_PB;
  }
  const Verdict verdict = model_->is_box ? detect_box(rock) : detect_hull(rock, support);
  if (verdict == Verdict::in_domain) refresh(rock);
  return verdict;
}

// Near the edge another direction than the vertical may part the two at less depth: where the edge is
// no farther off than the depth.
bool FastStepper::is_off_the_edge(const Vector3d& point, double depth) const {
  const FastModel& m = *model_;
  const double guard = m.guard + kTop.guard_of_depth * std::max(depth, 0.0);
  return !(std::fabs(point.x()) < m.support_half.x() - guard &&
           std::fabs(point.y()) < m.support_half.y() - guard);
}

// Bullet leaves a wrapped part alone, and forgets its contacts, while the boxes around it and the
// support are apart.
bool FastStepper::boxes_meet(const RockOverTop& rock) const {
  const FastModel& m = *model_;
  const Matrix3d R_PC = rock.R_PB * m.R_BC;
  const double centre =
      rock.p_PB.z() + rock.R_PB.row(2).dot(m.p_BC) + R_PC.row(2).dot(m.bounds_centre);
  return centre - R_PC.row(2).cwiseAbs().dot(m.bounds_half) <= m.support_half.z();
}

FastStepper::Verdict FastStepper::detect_box(const RockOverTop& rock) {
  const FastModel& m = *model_;
  const double top = m.support_half.z();
  const Matrix3d R_PC = rock.R_PB * m.R_BC;
  const Vector3d p_PC = rock.p_PB + rock.R_PB * m.p_BC;
  const Vector3d nr = R_PC.row(2).transpose();
  const double lowest = p_PC.z() - nr.cwiseAbs().dot(m.box_half);
  const double depth = top - lowest;
  if (depth > m.deepest) return Verdict::too_deep;
  // The face that looks down most, as Bullet picks it.
  const Vector3d anr = nr.cwiseAbs();
  const int axis = anr.y() > anr.x() ? (anr.y() > anr.z() ? 1 : 2) : (anr.x() > anr.z() ? 0 : 2);
  const int a1 = axis == 0 ? 1 : 0;
  const int a2 = axis == 2 ? 1 : 2;
  std::array<Vector3d, 4> corner_B;
  std::array<Vector3d, 4> corner_P;
  constexpr double signs[4][2] = {{-1, -1}, {-1, 1}, {1, 1}, {1, -1}};
  for (std::size_t k = 0; k < 4; ++k) {
    Vector3d corner;
    corner[axis] = nr[axis] < 0 ? m.box_half[axis] : -m.box_half[axis];
    corner[a1] = signs[k][0] * m.box_half[a1];
    corner[a2] = signs[k][1] * m.box_half[a2];
    corner_B[k] = m.p_BC + m.R_BC * corner;
    corner_P[k] = rock.p_PB + rock.R_PB * corner_B[k];
    if (is_off_the_edge(corner_P[k], depth)) return Verdict::off_the_top;
  }
  if (m.is_wrapped) refresh(rock);
  if (m.rock_is_first && !boxes_meet(rock)) count_ = 0;
  if (depth >= 0) {
    for (std::size_t k = 0; k < 4; ++k) {
      const double distance = corner_P[k].z() - top;
      if (distance <= 0) add(corner_B[k], {corner_P[k].x(), corner_P[k].y(), top}, distance);
    }
  }
  return Verdict::in_domain;
}

FastStepper::Verdict FastStepper::detect_hull(const RockOverTop& rock, const Support& support) {
  const FastModel& m = *model_;
  const double top = m.support_half.z();
  const Vector3d up_B = rock.R_PB.row(2).transpose();
  const std::size_t i = low_.lowest(up_B);
  const Vector3d vertex = m.vertices.view().at(i);
  Vector3d point = rock.p_PB + rock.R_PB * vertex;
  point.z() -= m.margin;
  const double distance = point.z() - top;
  if (is_off_the_edge(point, -distance)) return Verdict::off_the_top;
  if (-distance > m.deepest) return Verdict::too_deep;
  if (m.is_wrapped) refresh(rock);
  if (m.rock_is_first && !boxes_meet(rock)) {
    count_ = 0;
    return Verdict::in_domain;
  }
  // The margin lies along the support's normal, not in the rock's frame. Of level vertices each is a
  // contact of its own, as one of them is the lowest in turn; a point between them would be one more by
  // chance, since Bullet takes it only where they are level to `same_height`.
  if (m.engine.converged_contacts || low_.is_alone(i, up_B, m.same_height)) {
    add(vertex - m.margin * up_B, {point.x(), point.y(), top}, distance);
    return Verdict::in_domain;
  }
  Vector3d p_W_rock;
  Vector3d p_W_support;
  double between;
  if (closest_by_bullet(support, p_W_rock, p_W_support, between))
    add(state.q_WB.conjugate() * (p_W_rock - state.p_WB),
        support.R_WP.transpose() * (p_W_support - support.p_WP), between);
  return Verdict::in_domain;
}

}  // namespace vsr2

#include "vsr2/scene.hpp"

#include <cmath>
#include <initializer_list>
#include <limits>
#include <string>

#include <BulletCollision/CollisionDispatch/btInternalEdgeUtility.h>

#include "fast_stepper.hpp"
#include "hull_scan.hpp"
#include "scene_shapes.hpp"
#include "vsr2/engines.hpp"

namespace vsr2 {
namespace {

void require(bool condition, const std::string& message) {
  if (!condition) throw InvalidInput(message);
}

bool finite(const Eigen::Vector3d& v) { return v.allFinite(); }

// A number that must be finite, and at least `least` or, as `positive`, above 0.
struct Bound {
  const char* name;
  double value;
  double least = 0.0;
  const char* unit = "";
};
constexpr double positive = std::numeric_limits<double>::denorm_min();

void require_all(const std::string& what, std::initializer_list<Bound> bounds) {
  for (const auto& [name, value, least, unit] : bounds)
    require(std::isfinite(value) && value >= least,
            what + ": " + name + " must be " +
                (least == positive ? "positive" : "finite and at least " + std::to_string(least)) +
                ", got " + std::to_string(value) + (*unit ? " " : "") + unit);
}

void check_pose(const Pose& pose, const std::string& what) {
  require(finite(pose.position) && pose.orientation.coeffs().allFinite(), what + " is not finite");
  require(std::abs(pose.orientation.norm() - 1.0) < 1e-6,
          what + ": the quaternion has norm " + std::to_string(pose.orientation.norm()) + ", not 1");
}

void check_material(const ContactValues& material, const std::string& what) {
  for (std::size_t i = 0; i < material.all.size(); ++i) {
    const ContactParameter& parameter = kContactParameters[i];
    const auto& [least, greatest, above] = parameter.range;
    require_all(what, {{parameter.name, material.all[i], above ? std::nextafter(least, greatest) : least,
                        parameter.unit}});
    require(material.all[i] <= greatest, what + ": " + parameter.name + " must be at most " +
                                             std::to_string(greatest) + ", got " +
                                             std::to_string(material.all[i]));
  }
}

void check_engine(const EngineSettings& e) {
  require_all("engine", {{"gravity", e.gravity},
                         {"time_step", e.time_step, positive},
                         {"substeps", 1.0 * e.substeps, 1},
                         {"solver_iterations", 1.0 * e.solver_iterations, 1},
                         {"residual_threshold", e.residual_threshold},
                         {"restitution_velocity_threshold", e.restitution_velocity_threshold},
                         {"collision_margin", e.collision_margin},
                         {"contact_breaking_threshold", e.contact_breaking_threshold, positive},
                         {"linear_damping", e.linear_damping},
                         {"angular_damping", e.angular_damping}});
  require(e.time_step <= 0.1,
          "engine: time_step must lie in (0, 0.1] s, got " + std::to_string(e.time_step));
  require(e.substeps <= 100000, "engine: substeps must be at most 100000");
}

void check_mechanisms(const Mechanisms& m) {
  require_all("mechanisms",
              {{"impact_energy_ratio", m.sets_impacts() ? m.impact_energy_ratio : 0.0},
               {"rocking_damping", m.rocking_damping},
               {"rolling_resistance", m.rolling_resistance},
               {"friction_ratio", m.friction_ratio, 1.0},
               {"friction_speed", m.friction_speed, positive},
               {"adhesion", m.adhesion},
               {"catch_slack", m.catches() ? m.catch_slack : 0.0}});
}

void check_pitch_spring(const PitchSpring& s, const EngineSettings& engine) {
  const std::string what = "pedestal: pitch_spring";
  require_all(what, {{"frequency", s.frequency, positive, "Hz"}, {"damping", s.damping}});
  require(std::isfinite(s.compliance), what + ": compliance is not finite");
  require(s.inertia > 0,
          what + ": inertia must be positive, got " + std::to_string(s.inertia) + " kg m^2");
  // Within a step the joint must swing less than a quarter of its period.
  const double greatest = 0.25 * engine.substeps / engine.time_step;
  require(s.frequency < greatest,
          what + ": frequency must lie below a quarter of the solver's steps in a second, " +
              std::to_string(greatest) + " Hz, got " + std::to_string(s.frequency) +
              " Hz; lower it, or engine.time_step");
}

// Builds the shapes of one body. `X_BM` takes the parts' model frame into the body frame.
class ShapeBuilder {
 public:
  ShapeBuilder(Scene::Shapes& shapes, double margin) : shapes_(shapes), margin_(margin) {}

  btCollisionShape* body(const std::vector<Part>& parts, const btTransform& X_BM,
                         const std::string& what) {
    require(!parts.empty(), what + " has no collision part");
    // As PyBullet's createMultiBody: a lone part whose frame is the body's stays as it is, all else
    // goes into one compound.
    std::vector<std::pair<btTransform, btCollisionShape*>> children;
    for (const Part& part : parts) {
      if (const auto* hull = std::get_if<HullPart>(&part)) {
        children.emplace_back(btTransform::getIdentity(), own(hull->reduction().shape(margin_, what)));
      } else if (const auto* box = std::get_if<BoxPart>(&part)) {
        require(finite(box->size) && box->size.minCoeff() > 0, what + ": box sizes must be positive");
        check_pose(box->pose, what + ": box pose");
        auto* shape = own(std::make_unique<btBoxShape>(to_bullet(Eigen::Vector3d(0.5 * box->size))));
        children.emplace_back(to_bullet(box->pose), shape);
      } else {
        children.emplace_back(btTransform::getIdentity(),
                              triangles(std::get<TrianglesPart>(part), what));
      }
    }
    btCollisionShape* root = nullptr;
    if (children.size() == 1 && X_BM * children[0].first == btTransform::getIdentity()) {
      root = children[0].second;
    } else {
      // The compound has no margin of its own: it would widen the bounding box, and with it the
      // contact breaking threshold.
      auto compound = std::make_unique<btCompoundShape>();
      for (const auto& [X_MC, child] : children) compound->addChildShape(X_BM * X_MC, child);
      root = compound.get();
      shapes_.owned.push_back(std::move(compound));
    }
    return root;
  }

 private:
  template <typename Shape>
  Shape* own(std::unique_ptr<Shape> shape) {
    Shape* raw = shape.get();
    raw->setMargin(margin_);
    shapes_.owned.push_back(std::move(shape));
    return raw;
  }

  btCollisionShape* triangles(const TrianglesPart& part, const std::string& what) {
    require(!part.faces.empty(), what + ": the surface has no triangle");
    auto mesh = std::make_unique<btTriangleMesh>();
    mesh->preallocateVertices(static_cast<int>(part.faces.size() * 3));
    const auto count = static_cast<std::int64_t>(part.vertices.size());
    for (const auto& face : part.faces) {
      std::array<btVector3, 3> corner;
      for (int k = 0; k < 3; ++k) {
        require(face[k] >= 0 && face[k] < count, what + ": a triangle names a vertex that is not there");
        require(finite(part.vertices[face[k]]), what + ": a vertex is not finite");
        corner[k] = to_bullet(part.vertices[face[k]]);
      }
      mesh->addTriangle(corner[0], corner[1], corner[2]);
    }
    auto* shape = own(std::make_unique<btBvhTriangleMeshShape>(mesh.get(), true, true));
    shapes_.triangle_meshes.push_back(std::move(mesh));
    // Contacts at edges between triangles would push sideways; worlds correct their normals.
    auto edges = std::make_unique<btTriangleInfoMap>();
    btGenerateInternalEdgeInfo(shape, edges.get());
    shapes_.triangle_edges.push_back(std::move(edges));
    return shape;
  }

  Scene::Shapes& shapes_;
  double margin_;
};

bool has_triangles(const std::vector<Part>& parts) {
  for (const Part& part : parts)
    if (std::holds_alternative<TrianglesPart>(part)) return true;
  return false;
}

btVector3 box_inertia(const btCollisionShape& shape, double mass) {
  btVector3 lower;
  btVector3 upper;
  shape.getAabb(btTransform::getIdentity(), lower, upper);
  const btVector3 e = upper - lower;
  return mass / 12.0 *
         btVector3(e.y() * e.y() + e.z() * e.z(), e.x() * e.x() + e.z() * e.z(),
                   e.x() * e.x() + e.y() * e.y());
}

}  // namespace

HullPart::HullPart(std::vector<Eigen::Vector3d> points)
    : reduction_(std::make_shared<Reduction>(std::move(points))) {}

const std::vector<Eigen::Vector3d>& HullPart::points() const { return reduction_->points; }

std::unique_ptr<btConvexHullShape> HullPart::Reduction::shape(double margin, const std::string& what) {
  const std::lock_guard lock(mutex_);
  if (!kept_ || kept_->getMargin() != margin) {
    require(points.size() >= 4,
            what + ": a convex hull needs at least 4 points, got " + std::to_string(points.size()));
    auto hull = std::make_unique<btConvexHullShape>();
    hull->setMargin(margin);
    for (const Eigen::Vector3d& p : points) {
      require(finite(p), what + ": a hull point is not finite");
      hull->addPoint(to_bullet(p), false);
    }
    // The box is taken before the hull is reduced, as PyBullet does.
    hull->recalcLocalAabb();
    hull->optimizeConvexHull();
    require(hull->getNumVertices() >= 4, what + ": the hull's points lie in one plane");
    kept_ = std::move(hull);
  }
  return std::make_unique<btConvexHullShape>(*kept_);
}

Scene::Scene(EngineSettings engine, PedestalSpec pedestal, RockSpec rock, Mechanisms mechanisms)
    : engine_(engine),
      pedestal_(std::move(pedestal)),
      rock_(std::move(rock)),
      mechanisms_(mechanisms),
      shapes_(std::make_unique<Shapes>()) {
  check_engine(engine_);
  check_mechanisms(mechanisms_);
  check_material(rock_.material, "rock");
  check_material(pedestal_.material, "pedestal");
  require_all("rock", {{"mass", rock_.mass, positive, "kg"}});
  require_all("pedestal", {{"mass", pedestal_.mass, positive, "kg"}});
  require(finite(pedestal_.base_size) && pedestal_.base_size.minCoeff() > 0,
          "pedestal: base sizes must be positive");
  require(finite(pedestal_.p_WP0) && std::isfinite(pedestal_.top) && std::isfinite(pedestal_.pitch_pivot),
          "pedestal: position is not finite");
  if (pedestal_.pitch_spring) check_pitch_spring(*pedestal_.pitch_spring, engine_);
  check_pose(rock_.X_MB, "rock: body frame");
  if (mechanisms_.sets_impacts()) rock_.material["restitution"] = 0.0;
  require(!has_triangles(rock_.parts),
          "rock: an exact triangle surface cannot move freely; use its convex hull or a decomposition");
  if (!rock_.inertia_from_aabb) {
    const Eigen::Vector3d& I = rock_.principal_inertia;
    require(finite(I) && I.minCoeff() > 0, "rock: principal inertia must be positive");
    // Equality holds for a plate; the tolerance covers rounding.
    require(I.sum() * (1 + 1e-9) >= 2 * I.maxCoeff(),
            "rock: principal inertia breaks the triangle inequality; no body has it");
  }

  ShapeBuilder build(*shapes_, engine_.collision_margin);
  // The box of plane.urdf of pybullet_data.
  shapes_->ground = std::make_unique<btBoxShape>(btVector3(100, 100, 5));
  shapes_->ground->setMargin(engine_.collision_margin);
  shapes_->base = std::make_unique<btBoxShape>(to_bullet(Eigen::Vector3d(0.5 * pedestal_.base_size)));
  shapes_->base->setMargin(engine_.collision_margin);
  shapes_->pedestal = build.body(pedestal_.parts, btTransform::getIdentity(), "pedestal");
  shapes_->pedestal_inertia = box_inertia(*shapes_->pedestal, pedestal_.mass);
  shapes_->rock = build.body(rock_.parts, to_bullet(rock_.X_MB).inverse(), "rock");
  shapes_->scanned_rock = with_scanned_hulls(shapes_->rock, shapes_->owned);
  if (rock_.inertia_from_aabb) {
    shapes_->rock->calculateLocalInertia(rock_.mass, shapes_->rock_inertia);
  } else {
    shapes_->rock_inertia = to_bullet(rock_.principal_inertia);
  }
  if (fast_refusal(*this) == FastRefusal::none)
    shapes_->fast_model = std::make_shared<const FastModel>(*this);
}

Scene::~Scene() = default;

Eigen::Vector3d Scene::rock_inertia() const { return to_eigen(shapes_->rock_inertia); }

namespace {
void collect_vertices(const btCollisionShape* shape, const btTransform& X_BS,
                      std::vector<Eigen::Vector3d>& out) {
  if (shape->isCompound()) {
    const auto* compound = static_cast<const btCompoundShape*>(shape);
    for (int i = 0; i < compound->getNumChildShapes(); ++i)
      collect_vertices(compound->getChildShape(i), X_BS * compound->getChildTransform(i), out);
  } else if (shape->isPolyhedral()) {
    const auto* polyhedron = static_cast<const btPolyhedralConvexShape*>(shape);
    for (int i = 0; i < polyhedron->getNumVertices(); ++i) {
      btVector3 v;
      polyhedron->getVertex(i, v);
      out.push_back(to_eigen(X_BS * v));
    }
  }
}
}  // namespace

std::vector<Eigen::Vector3d> Scene::rock_hull_vertices() const {
  std::vector<Eigen::Vector3d> out;
  collect_vertices(shapes_->rock, btTransform::getIdentity(), out);
  return out;
}

}  // namespace vsr2
